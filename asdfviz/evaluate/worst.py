"""The frames in which a run's poses lie farthest from the truth, as the report and the app list them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from asdfviz.evaluate.numbering import clock_rise
from asdfviz.evaluate.pose_errors import PoseError
from asdfviz.evaluate.protocols import VISIBLE
from asdfviz.evaluate.records import PoseRecord

SHOWN = 4
"""So many of a run, unless more are asked for."""
MEASURE = "ADD(S)"
"""What they are ranked by; in millimetres where it is shown."""
TOLD = (
    f"By {MEASURE}, the mean distance of a part's points from where they are in truth: in each frame "
    "the part that is farthest off, of those of which 10 % can be seen. Of frames close together only "
    "the worst is listed."
)
"""What to say of them."""

_APART = 5
"""Frames nearer than this look alike."""


@dataclass(frozen=True, slots=True, eq=False)
class WorstFrame:
    """A part that lies wrong in a frame."""

    record: PoseRecord
    error: PoseError
    """That of the record, which has one."""

    @property
    def add_s_mm(self) -> float:
        """What it is ranked by."""
        return 1000 * self.error.add_s


def worst_frames(records: Iterable[PoseRecord], *, count: int = SHOWN) -> tuple[WorstFrame, ...]:
    """The visible parts that lie farthest from the truth, one a frame, worst first."""
    by_frame: dict[int, WorstFrame] = {}
    for record in records:
        if record.error is None or record.visible < VISIBLE:
            continue
        other = by_frame.get(record.frame_index)
        if other is None or record.error.add_s > other.error.add_s:
            by_frame[record.frame_index] = WorstFrame(record, record.error)
    apart = _APART * (clock_rise(sorted(by_frame)) or 1)
    chosen: list[WorstFrame] = []
    for one in sorted(by_frame.values(), key=lambda one: -one.error.add_s):
        index = one.record.frame_index
        if all(abs(index - other.record.frame_index) >= apart for other in chosen):
            chosen.append(one)
    return tuple(chosen[:count])
