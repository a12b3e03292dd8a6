"""Where there are poses, frame by frame: the lane above the states' rows. Pure.

With a part selected it says where its poses are from; else in how many of the parts there is one.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

from asdfviz.annotate.records import BY_STATE, TRACKED, Said, gone_of
from asdfviz.app import theme
from asdfviz.app.markup import chip, text
from asdfviz.app.timeline import light, span_style

Kind = Literal["verified", "hand", "tracked", "state", "base", "gone", "none", "some"]

_DERIVED: dict[str, tuple[Kind, str]] = {
    TRACKED: ("tracked", "tracked"),
    BY_STATE: ("state", "placed by the state"),
}
_HINT = (
    "Poses: full where a person set them, lighter where they were tracked or placed by the state, dim where "
    "a run or the truth has them, empty where there is none"
)


@dataclass(frozen=True, slots=True)
class Cell:
    """What is known in one frame."""

    kind: Kind
    say: str
    share: float = 1.0
    """Of the parts that have a pose, where several are meant."""
    is_gap: bool = False
    """Whether a pose is missing that nobody said is not there."""

    @property
    def is_posed(self) -> bool:
        """Whether there is a pose."""
        return self.kind not in ("none", "gone")


@dataclass(frozen=True, slots=True)
class Lane:
    """The lane of one part, or of all."""

    part: str | None
    cells: tuple[Cell, ...]
    """One a frame."""
    color: theme.Rgb3
    """Of poses that nobody corrected."""

    def gap(self, place: int, direction: int) -> int | None:
        """The next (1) or previous (-1) place at which a pose is missing."""
        ahead = range(place + 1, len(self.cells)) if direction > 0 else range(place - 1, -1, -1)
        return next((at for at in ahead if self.cells[at].is_gap), None)

    def source(self, place: int) -> int | None:
        """The place to copy a pose from: the nearest before that has one, else the nearest after."""
        beside = (*range(place - 1, -1, -1), *range(place + 1, len(self.cells)))
        return next((at for at in beside if self.cells[at].is_posed), None)


def lane_of(
    part: str | None,
    indices: Sequence[int],
    parts: Collection[str],
    *,
    said: Said,
    held: Sequence[Collection[str]],
    source: tuple[str, theme.Rgb3],
) -> Lane:
    """The lane of a part, or of all.

    Args:
        part: its name; None for all.
        indices: numbers of the frames.
        parts: names of the assembly's parts.
        said: what was said by hand or derived, see `AnnotationStore.said`.
        held: by place, the parts of which a run or the truth knows the pose.
        source: the name and colour of that run, or of the truth.
    """
    name, color = source
    if part is not None:
        cells = tuple(
            _cell(said.get((index, part)), name if part in has else None)
            for index, has in zip(indices, held, strict=True)
        )
        return Lane(part, cells, color)
    gone = gone_of(said)
    sums = [
        (
            sum((i, p) not in gone and ((i, p) in said or p in has) for p in parts),
            sum((i, p) not in gone for p in parts),
        )
        for i, has in zip(indices, held, strict=True)
    ]
    return Lane(None, tuple(_sum(found, there) for found, there in sums), color)


def build(lane: Lane, label: str, *, count: int, color: theme.Rgb3) -> str:
    """The lane as HTML; `label` and `color` are those of the part, or any where all are meant."""
    row = "poses" if lane.part is None else f"poses of {lane.part}"
    hint = _HINT if lane.part is None else f"{lane.part}. {_HINT}"
    inner = "".join(_piece(*piece, lane.color, count) for piece in light(lane.cells))
    return (
        f'<div class="tl-row tl-lane" data-testid="tl-poses" data-row="{text(row)}">'
        f'<span class="tl-label" title="{text(hint)}">{chip(color, shape="dot")}<span>{text(label)}</span></span>'
        f'<div class="tl-strip">{inner}<b class="tl-cursor"></b></div></div>'
    )


def _piece(first: int, last: int, cell: Cell, base: theme.Rgb3, count: int) -> str:
    color = base if cell.kind == "base" else theme.ANNOTATION
    style = f"{span_style(first, last, count)};--ink:{theme.css(color)};--share:{cell.share:.3f}"
    return (
        f'<i class="tl-pose tl-pose-{cell.kind}" data-first="{first}" data-last="{last}" '
        f'data-say="{text(cell.say)}" style="{style}"></i>'
    )


def _cell(said: tuple[str, str] | None, source: str | None) -> Cell:
    if said is None and source is None:
        return Cell("none", "no pose", is_gap=True)
    if said is None:
        return Cell("base", f"from {source}")
    kind, provenance = said
    if kind == "remove_pose":
        return Cell("gone", "not in the frame")
    if kind == "verify":
        return Cell("verified", "verified")
    by_hand = "placed by hand" if source is None else "corrected"
    return Cell(*_DERIVED.get(provenance, ("hand", by_hand)))


def _sum(found: int, there: int) -> Cell:
    say = f"{found} of {there} parts have a pose"
    if found == 0:
        return Cell("none" if there else "gone", say, 0.0, is_gap=there > 0)
    return Cell("some", say, found / there, is_gap=found < there)
