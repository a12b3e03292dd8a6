"""Parts that the state holds, whose colours were learnt on another thing.

Not in the paper. A part that was followed on a hand, or turned otherwise than it is, has the colours that
were seen there; once the state has it in its joint those speak against it for good, though depth agrees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from asdfviz.datatypes import Frame
from asdfviz.errors import MethodError
from asdfviz.methods.track_memory import Track
from asdfviz.track.confidence import Evidence
from asdfviz.track.tracker import Tracker


@dataclass(frozen=True)
class HeldConfig:
    """When the colours of a held part are learnt anew."""

    seen: float = 0.5
    """As much of it must be seen, and as much of that fit depth, 0 to 1,"""
    unlike: float = 0.5
    """while it is less probable than this that it is there, 0 to 1,"""
    frames: int = 3
    """in so many frames that show it so."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 < self.seen <= 1 or not 0 <= self.unlike <= 1 or self.frames < 1:
            raise MethodError(
                f"refind.held.seen is {self.seen:g}, unlike {self.unlike:g} and frames {self.frames}: "
                "seen must be above 0 and at most 1, unlike 0 to 1, frames 1 or more"
            )


def learn_held(
    frame: Frame,
    tracker: Tracker,
    tracks: Mapping[str, Track],
    held: Mapping[str, Evidence],
    *,
    config: HeldConfig,
) -> None:
    """Learn the colours of held parts anew that depth has where they are held, and colours do not.

    Args:
        frame: in which the parts are at the tracker's poses.
        tracker: whose colours they are.
        tracks: of all parts that are tracked; how often each was unlike itself is noted there.
        held: what the frame says of the parts that the state holds.
        config: when they are.
    """
    for name, seen in held.items():
        track = tracks[name]
        if min(seen.visible, seen.fit) < config.seen:
            continue
        track.unlike = track.unlike + 1 if tracker.judged(seen) < config.unlike else 0
        if track.unlike >= config.frames:
            tracker.begin_colors(frame, name)
            track.unlike = 0
