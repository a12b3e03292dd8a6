"""How sure parts are that the state holds and that something hides.

Not in the paper. Nothing of a hidden part can be seen, but the base that holds it can.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from asdfviz.datatypes import PoseEstimate
from asdfviz.methods.track_memory import Track


def sure_as_the_base(
    poses: Mapping[str, PoseEstimate], tracks: Mapping[str, Track], *, base: str, share: float
) -> dict[str, PoseEstimate]:
    """Return the poses, those of held parts that are hidden at least as sure as the base, times `share`.

    Where the part is seen, and does not fit, what is seen counts.
    """
    if base not in poses:
        return dict(poses)
    least = share * poses[base].score
    return {
        name: replace(pose, score=max(pose.score, least)) if _is_hidden(tracks[name]) else pose
        for name, pose in poses.items()
    }


def _is_hidden(track: Track) -> bool:
    """Held, not sure by what shows of it, and not seen to be elsewhere."""
    return track.joined and track.unsure > 0 and track.missing == 0
