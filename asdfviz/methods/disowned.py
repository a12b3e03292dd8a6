"""When a tracked part is not what the networks keep saying, and hardly fits the picture either.

Not in the paper. A part that was begun on something else, a hand or another part, has learnt that thing's
colours, which from then on speak against every right pose. Detector and crop network see each frame
afresh: where they agree for a while, and depth does not contradict, they are right.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from asdfviz.datatypes import PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.track_memory import Track
from asdfviz.track.starts import Trial


@dataclass(frozen=True)
class DisownedConfig:
    """When the networks are believed and the tracker is not."""

    enabled: bool = True
    """On or off."""
    frames: int = 4
    """More frames must speak against a tracked pose than for it by this."""
    score: float = 0.4
    """Least score, 0 to 1, of the detector's pose;"""
    liked: float = 0.5
    """the crop network's least preference for its rotation, 0 to 1,"""
    disliked: float = 0.1
    """and its greatest for the tracked one."""
    poor: float = 0.4
    """What fits the picture better than this (`Trial.score`, up to 2) is not disowned."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if self.frames < 1 or not self.disliked < self.liked:
            raise MethodError(
                f"refind.disowned.frames is {self.frames}, disliked {self.disliked:g} and liked "
                f"{self.liked:g}: frames must be 1 or more, disliked below liked"
            )


def is_disowned(
    track: Track,
    proposal: PoseEstimate,
    look: LookedAt | None,
    settle: Callable[[Sequence[Transform]], list[Trial]],
    *,
    config: DisownedConfig,
) -> bool:
    """Whether a part is to begin anew at the detector's pose; counts the frames that say so.

    Args:
        track: of the part, which nothing holds.
        proposal: the detector's pose of it in this frame,
        look: and what that came from; without it nothing is known.
        settle: settles poses of the part in this frame.
        config: what it takes.
    """
    T_tracked, T_seen = track.T_now, proposal.T_camera_part
    if look is None or not config.enabled or proposal.score < config.score:
        return False
    if look.likely(T_seen) < config.liked:
        return False
    if look.likely(T_tracked) > config.disliked:
        track.disowned = 0
        return False
    tracked, seen = settle([T_tracked, T_seen])
    is_worse = tracked.score < config.poor and seen.sharp >= tracked.sharp
    track.disowned = max(track.disowned + (1 if is_worse else -1), 0)
    return track.disowned >= config.frames
