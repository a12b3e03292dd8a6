"""Inline drawings of the report: error curves, state strips, confusion, calibration. Pure strings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.evaluate.report_style import DASHES, escape, on_state, part_color

_WIDTH, _HEIGHT = 520, 300
_STRIP_WIDTH, _LETTER_WIDTH = 900, 7
"""Pixels of a strip on a wide page, and of a letter in it: what does not fit is not written."""
_LEFT, _RIGHT, _TOP, _BOTTOM = 46, 14, 12, 40


Place = Callable[[float, float], tuple[float, float]]
"""Where a figure and its percent lie in the drawing."""


@dataclass(frozen=True, slots=True)
class Curve:
    """A line of a chart."""

    name: str
    color: str
    """As CSS writes it."""
    dash: str
    x: Sequence[float]
    y: Sequence[float]


def run_color(place: int) -> str:
    """The colour of a run, by its place, in light and dark."""
    return f"var(--run{place % len(DASHES)})"


def recall_curve(
    errors_by_part: Mapping[str, Sequence[float]], *, limit: float, points: int = 161
) -> tuple[list[float], list[float]]:
    """Percent of each part's errors below a threshold, mean over parts, for thresholds to `limit`.

    Infinite errors are misses. A part without any error does not count.
    """
    thresholds = np.linspace(0.0, limit, points)
    shares = [
        100.0 * (np.array(errors)[:, None] < thresholds).mean(axis=0)
        for errors in errors_by_part.values()
        if len(errors)
    ]
    if not shares:
        return [], []
    return thresholds.tolist(), np.mean(shares, axis=0).tolist()


def line_chart(
    curves: Iterable[Curve],
    *,
    x_limit: float,
    x_title: str,
    y_title: str,
    marks: Mapping[float, str] | None = None,
    description: str,
) -> str:
    """An SVG with percent upwards, and its legend; a sentence where no curve has a point."""
    curves = list(curves)
    if not any(curve.x for curve in curves):
        return "<p>The truth has no poses to compare with.</p>"
    wide, high = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM

    def place(x: float, y: float) -> tuple[float, float]:
        return _LEFT + wide * x / x_limit, _TOP + high * (1 - y / 100)

    parts = [_frame(place, x_limit, x_title, y_title)]
    for x, title in (marks or {}).items():
        u, _ = place(x, 0.0)
        parts.append(
            f'<line class="mark" x1="{u:.1f}" x2="{u:.1f}" y1="{_TOP}" y2="{_TOP + high}"/>'
        )
        parts.append(f'<text x="{u + 4:.1f}" y="{_TOP + high - 6}">{escape(title)}</text>')
    for curve in curves:
        line = " ".join(f"{u:.1f},{v:.1f}" for u, v in map(place, curve.x, curve.y))
        parts.append(
            f'<polyline class="curve" points="{line}" style="stroke:{curve.color};'
            f'stroke-dasharray:{curve.dash or "none"}"><title>{escape(curve.name)}</title></polyline>'
        )
    drawing = "".join(parts)
    return (
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" '
        f'aria-label="{escape(description)}">{drawing}</svg>{_legend(curves)}'
    )


def _frame(place: Place, x_limit: float, x_title: str, y_title: str) -> str:
    """Grid, axes and their figures."""
    parts: list[str] = []
    for percent in (0.0, 25.0, 50.0, 75.0, 100.0):
        _, v = place(0.0, percent)
        kind = "axis" if percent == 0 else "grid"
        parts.append(
            f'<line class="{kind}" x1="{_LEFT}" x2="{_WIDTH - _RIGHT}" y1="{v:.1f}" y2="{v:.1f}"/>'
        )
        parts.append(f'<text x="{_LEFT - 8}" y="{v + 4:.1f}" text-anchor="end">{percent:g}</text>')
    for step in range(6):
        x = x_limit * step / 5
        u, v = place(x, 0.0)
        parts.append(f'<text x="{u:.1f}" y="{v + 17:.1f}" text-anchor="middle">{x:g}</text>')
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    parts.append(
        f'<text x="{middle:.0f}" y="{_HEIGHT - 5}" text-anchor="middle">{escape(x_title)}</text>'
    )
    half = (_TOP + _HEIGHT - _BOTTOM) / 2
    parts.append(
        f'<text transform="translate(12 {half:.0f}) rotate(-90)" text-anchor="middle">'
        f"{escape(y_title)}</text>"
    )
    return "".join(parts)


def _legend(curves: Sequence[Curve]) -> str:
    entries = "".join(
        f'<span><svg viewBox="0 0 30 10"><line x1="0" x2="30" y1="5" y2="5" stroke-width="3" '
        f'style="stroke:{curve.color};stroke-dasharray:{curve.dash or "none"}"/></svg>'
        f"{escape(curve.name)}</span>"
        for curve in curves
    )
    return f'<div class="legend">{entries}</div>'


def part_curves(
    errors_by_part: Mapping[str, Sequence[float]], assembly: Assembly, *, limit: float
) -> list[Curve]:
    """One curve a part, in the part's colour."""
    curves: list[Curve] = []
    for place, name in enumerate(assembly.parts):
        x, y = recall_curve({name: errors_by_part.get(name, ())}, limit=limit)
        if x:
            dash = DASHES[(place // 4) % len(DASHES)]
            curves.append(Curve(name, part_color(place), dash, x, y))
    return curves


State = tuple[int | None, bool]
"""Last completed state (None where nobody says one), and whether there is an error."""


def state_strip(
    title: str, states: Sequence[State], frames: Sequence[int], assembly: Assembly
) -> str:
    """One row: the states as boxes as wide as they last; each says its name and frames."""
    boxes: list[str] = []
    start = 0
    for state, members in groupby(states):
        count = len(list(members))
        last = start + count - 1
        kind, style, name = _state_look(state, assembly)
        room = _STRIP_WIDTH * count / len(states) / _LETTER_WIDTH
        label = next((text for text in (name, str(state[0])) if len(text) + 1 <= room), "")
        hint = escape(f"{name}, frames {frames[start]} to {frames[last]}")
        boxes.append(
            f'<i class="{kind}" style="flex-grow:{count};{style}" title="{hint}">{escape(label)}</i>'
        )
        start += count
    shown = escape(title)
    return f'<div class="strip"><b title="{shown}">{shown}</b><div class="bar">{"".join(boxes)}</div></div>'


def error_line(
    errors_mm: Sequence[float | None],
    missed: Sequence[float],
    *,
    color: str,
    limit_mm: float = 50.0,
) -> str:
    """A thin curve below a strip, mean ADD(S) of each frame cut off at `limit_mm`, over bars as high as
    the share of the visible parts without a pose, 0 to 1."""
    count = max(len(errors_mm) - 1, 1)
    lines = _missed_bars(missed, 1000 / count)
    numbered = enumerate(errors_mm)
    for known, members in groupby(numbered, key=lambda item: item[1] is not None):
        if known:
            points = [(i, min(e, limit_mm)) for i, e in members if e is not None]
            points = points if len(points) > 1 else [points[0], (points[0][0] + 0.5, points[0][1])]
            line = " ".join(
                f"{1000 * i / count:.1f},{23 - 22 * e / limit_mm:.1f}" for i, e in points
            )
            lines.append(
                f'<polyline points="{line}" fill="none" vector-effect="non-scaling-stroke"/>'
            )
    return (
        '<div class="strip"><div class="off"><svg viewBox="0 0 1000 24" preserveAspectRatio="none" '
        f'style="stroke:{color};stroke-width:1.4"><title>mean ADD(S) of the visible parts, 0 to '
        f"{limit_mm:g} mm; bars: of them without a pose</title>{''.join(lines)}</svg></div></div>"
    )


def _missed_bars(missed: Sequence[float], width: float) -> list[str]:
    bars: list[str] = []
    start = 0
    for share, members in groupby(missed):
        frames = len(list(members))
        if share > 0:
            bars.append(
                f'<rect x="{width * (start - 0.5):.1f}" y="{23 - 22 * share:.1f}" '
                f'width="{width * frames:.1f}" height="{22 * share:.1f}" class="missed"/>'
            )
        start += frames
    return bars


def frame_ticks(frames: Sequence[int]) -> str:
    """The frame numbers below the strips."""
    places = sorted({round(i * (len(frames) - 1) / 6) for i in range(7)})
    span = max(len(frames) - 1, 1)
    marks = "".join(f'<span style="left:{100 * p / span:.2f}%">{frames[p]}</span>' for p in places)
    return f'<div class="strip"><div class="ticks">{marks}</div></div>'


def state_legend(assembly: Assembly) -> str:
    """What the colours of the strips mean."""
    looks: list[State] = [(state.index, False) for state in assembly.steps]
    looks += [(0, True)] if assembly.errors else []
    entries = "".join(
        f'<span><i class="chip {kind}" style="{style}"></i>{escape(name)}</span>'
        for kind, style, name in (_state_look(look, assembly) for look in (*looks, (None, False)))
    )
    return f'<div class="legend">{entries}</div>'


def _state_look(state: State, assembly: Assembly) -> tuple[str, str, str]:
    """CSS class, style and name of a state."""
    index, is_error = state
    if index is None:
        return "none", "", "none"
    if is_error:
        return "error", "", "error"
    fill, ink = on_state(index, len(assembly.steps))
    return "", f"background:{fill};color:{ink}", assembly.steps[index].name


def confusion_table(confusion: Mapping[str, Any]) -> str:
    """Rows are true, columns said; each cell its frames and its share of the row.

    Errors and "none" have a row or column only where there is something in it.
    """
    columns = [str(name) for name in confusion["predicted"]]
    frames: list[list[int]] = confusion["frames"]
    odd = ("error", "none")
    shown = [
        j for j, name in enumerate(columns) if name not in odd or any(row[j] for row in frames)
    ]
    heads = "".join(
        f'<th title="{escape(columns[j])}">{escape(columns[j] if columns[j] in odd else j)}</th>'
        for j in shown
    )
    rows: list[str] = []
    for i, (name, row) in enumerate(zip(confusion["true"], frames, strict=True)):
        if name in odd and not any(row):
            continue
        title = escape(name if name in odd else f"{i}  {name}")
        cells = "".join(_confusion_cell(row[j], sum(row), is_right=i == j) for j in shown)
        rows.append(f'<tr><th class="t" title="{title}">{title}</th>{cells}</tr>')
    return (
        f'<div class="scroll"><table class="matrix"><thead><tr><th class="t">true \\ said</th>{heads}</tr>'
        f"</thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def _confusion_cell(count: int, total: int, *, is_right: bool) -> str:
    if not count:
        return "<td></td>"
    share = 100 * count / total
    color = "var(--good)" if is_right else "var(--bad)"
    fill = f"background:color-mix(in srgb,{color} {8 + 0.42 * share:.0f}%,var(--card))"
    return f'<td style="{fill}">{count}<small>{share:.0f} %</small></td>'


def reliability_curve(details: Mapping[str, Any], *, name: str, color: str, dash: str) -> Curve:
    """Share that was right over how sure the run was, both in percent."""
    bins = details["reliability"]
    return Curve(name, color, dash, [b["confidence"] for b in bins], [b["accuracy"] for b in bins])
