"""Which tracked poses bear witness for the state, and how much each is worth.

A tracker judges a pose by colours that it learnt at that very pose, so it is as sure of a wrong place as
of the right one; how often the detector found the part there tells them apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from asdfviz.datatypes import PoseEstimate
from asdfviz.methods.track_memory import Track

TRUSTED = 0.8
"""A pose that is trusted less teaches neither a part's colours nor where it sits in its joint."""


def witnesses(
    poses: Mapping[str, PoseEstimate], tracks: Mapping[str, Track], *, base: str
) -> tuple[dict[str, PoseEstimate], dict[str, PoseEstimate]]:
    """The poses that may be believed, and those that bear witness, scored by what they are worth.

    What the state holds together cannot bear witness for the state. The base is asked of the picture
    in many ways besides, and is believed.

    Args:
        poses: as they are tracked.
        tracks: what is remembered of these parts.
        base: name of the base part.
    """
    trust = {
        name: 1.0 if name == base or pose.stage == "group" else tracks[name].trust
        for name, pose in poses.items()
    }
    trusted = {name: pose for name, pose in poses.items() if trust[name] >= TRUSTED}
    free = {
        name: replace(pose, score=trust[name] * pose.score)
        for name, pose in poses.items()
        if pose.stage != "group"
    }
    return trusted, free
