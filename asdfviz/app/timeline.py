"""The strip of states under the picture: rows, segments, cursor. Pure.

A row is the annotation, the truth or a run. Segments meet on frame boundaries, so frame i covers the
share i/n to (i + 1)/n of the width and the cursor stands in its middle.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from asdfviz.annotate.records import StateLabel
from asdfviz.app import theme
from asdfviz.app.markup import chip, text
from asdfviz.data.truth import fitting_errors
from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth
from asdfviz.render.state_ramp import state_color

MAX_SEGMENTS = 500
"""More than a row has pixels for; longer rows are thinned out."""
NAMED = 3
"""Parts that a verdict calls by name; of more it says how many."""
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class Mark:
    """What a row says of one frame."""

    state: int
    """Index of the last correctly completed state."""
    is_error: bool = False
    name: str = ""
    """In words."""


@dataclass(frozen=True, slots=True)
class Segment:
    """Frames first to last (both included) that say the same; None where nothing is said."""

    first: int
    last: int
    mark: Mark | None


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a person said of one frame without moving or labelling anything."""

    verified: tuple[str, ...] = ()
    """Parts whose poses are right."""
    gone: tuple[str, ...] = ()
    """Parts that are not there."""
    unlabelled: bool = False
    """Whether a state label was taken away."""

    @property
    def words(self) -> str:
        """The verdict as the timeline tells it."""
        told = [f"verified: {_names(self.verified)}"] if self.verified else []
        told += [f"not in the frame: {_names(self.gone)}"] if self.gone else []
        return " \u00b7 ".join([*told, *["state label taken away"][: self.unlabelled]])


@dataclass(frozen=True, slots=True)
class Row:
    """One strip."""

    key: str
    label: str
    color: theme.Rgb3
    marks: tuple[Mark | None, ...]
    """One a frame."""
    probabilities: tuple[float | None, ...] = ()
    """Of the marked state, 0 to 1; empty where the row has none."""
    hint: str = ""
    verdicts: tuple[Verdict | None, ...] = ()
    """One a frame; empty where the row has none."""


def mark_of_state(assembly: Assembly, index: int) -> Mark:
    """The mark of a state of the assembly, error states included."""
    state = assembly.states[index]
    return Mark(state.completed, state.is_error, state.name)


def mark_of_truth(assembly: Assembly, truth: FrameTruth | None) -> Mark | None:
    """The mark of a truth, which keeps state and error apart; None where no state is known."""
    if truth is None or truth.state is None:
        return None
    if not truth.is_error:
        return Mark(truth.state, name=_name(assembly, truth.state))
    names = [error.name for error in fitting_errors(truth, assembly)]
    unheard = f"{_name(assembly, truth.state)}, with an error"
    return Mark(truth.state, is_error=True, name=next(iter(names), unheard))


def mark_of_label(assembly: Assembly, label: StateLabel | None) -> Mark | None:
    """The mark of what a person said."""
    if label is None:
        return None
    return Mark(label.state, label.is_error, label.name or _name(assembly, label.state))


def _name(assembly: Assembly, index: int) -> str:
    return assembly.states[index].name if index < len(assembly.states) else f"state {index}"


def mark_of_prediction(assembly: Assembly, prediction: FramePrediction | None) -> Mark | None:
    """The mark of what a method says."""
    if prediction is None or prediction.state is None:
        return None
    return mark_of_state(assembly, prediction.state.index)


def color_of(mark: Mark, steps: int) -> theme.Rgb3:
    """Of a mark's chip, on the ramp of so many correct states; errors have their own."""
    return theme.ERROR if mark.is_error else state_color(min(mark.state, steps - 1), steps)


def segments(marks: Sequence[Mark | None]) -> tuple[Segment, ...]:
    """Join equal neighbours."""
    return tuple(Segment(*stretch) for stretch in stretches(marks))


def boundaries(rows: Sequence[Row]) -> tuple[int, ...]:
    """First frames of all segments of all rows, in order, where a key may jump to."""
    starts = {s.first for row in rows for s in segments(row.marks) if s.mark is not None}
    return tuple(sorted(starts))


def frame_at(share: float, count: int) -> int:
    """The frame under a share (0 to 1) of the strip's width."""
    return min(max(int(share * count), 0), count - 1)


def cursor_share(place: int, count: int) -> float:
    """Where the cursor of a frame stands, as a share of the width."""
    return (place + 0.5) / count


def build(rows: Sequence[Row], *, count: int, steps: int) -> str:
    """The rows as HTML.

    Args:
        rows: in order, from the top.
        count: frames of the sequence.
        steps: correct states of the assembly, for the ramp.
    """
    return "".join(_row(row, count, steps) for row in rows)


def _row(row: Row, count: int, steps: int) -> str:
    inner = "".join(_segment(Segment(*piece), count, steps) for piece in light(row.marks))
    inner += "".join(_verdict(*piece, count) for piece in light(row.verdicts))
    percents = [None if p is None else round(100 * p) for p in row.probabilities]
    data = f' data-p="{text(json.dumps(percents))}"' if percents else ""
    return (
        f'<div class="tl-row" data-testid="tl-{text(row.key)}" data-row="{text(row.label)}"{data}>'
        f'<span class="tl-label" title="{text(row.hint or row.label)}">'
        f"{chip(row.color, shape='dot')}<span>{text(row.label)}</span></span>"
        f'<div class="tl-strip">{inner}<b class="tl-cursor"></b></div></div>'
    )


def light(values: Sequence[_T]) -> list[tuple[int, int, _T]]:
    """First and last place of equal neighbours, and their value; thinned where they are too many.

    Then every n-th frame speaks for its neighbours, so that the strip stays light.
    """
    joined = stretches(values)
    if len(joined) <= MAX_SEGMENTS:
        return joined
    stride = -(-len(values) // MAX_SEGMENTS)
    return [
        (first, min(first + stride, len(values)) - 1, values[first])
        for first in range(0, len(values), stride)
    ]


def stretches(values: Sequence[_T]) -> list[tuple[int, int, _T]]:
    """First and last place of equal neighbours, and their value."""
    joined: list[tuple[int, int, _T]] = []
    for place, value in enumerate(values):
        if joined and joined[-1][2] == value:
            joined[-1] = (joined[-1][0], place, value)
        else:
            joined.append((place, place, value))
    return joined


def _segment(piece: Segment, count: int, steps: int) -> str:
    place = span_style(piece.first, piece.last, count)
    if piece.mark is None:
        return f'<i class="tl-none" style="{place}" data-say="no state"></i>'
    mark = piece.mark
    color = state_color(min(mark.state, steps - 1), steps)
    ink = theme.css(theme.ink(color))
    label = f"<em>{mark.state} {text(mark.name)}</em>"
    return (
        f'<i class="{"tl-error" if mark.is_error else ""}" data-state="{mark.state}" '
        f'data-first="{piece.first}" data-last="{piece.last}" '
        f'data-say="{text(f"{mark.state} {mark.name}")}" '
        f'style="{place};--at:{piece.first / count:.6f};background-color:{theme.css(color)};color:{ink}">{label}</i>'
    )


def _verdict(first: int, last: int, verdict: Verdict | None, count: int) -> str:
    """A line below the strip: solid, dashed or both; hatches the strip where a label was taken away."""
    if verdict is None:
        return ""
    kinds = {
        "tl-verified": verdict.verified,
        "tl-gone": verdict.gone,
        "tl-unlabelled": verdict.unlabelled,
    }
    classes = " ".join(name for name, is_said in kinds.items() if is_said)
    return (
        f'<i class="tl-verdict {classes}" data-first="{first}" data-last="{last}" '
        f'data-also="{text(verdict.words)}" style="{span_style(first, last, count)}"></i>'
    )


def span_style(first: int, last: int, count: int) -> str:
    """Where frames first to last lie on the strip, as CSS."""
    return f"left:{100 * first / count:.4f}%;width:{100 * (last + 1 - first) / count:.4f}%"


def _names(parts: tuple[str, ...]) -> str:
    return ", ".join(parts) if len(parts) <= NAMED else f"{len(parts)} parts"
