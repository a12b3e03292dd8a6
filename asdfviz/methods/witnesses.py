"""Which tracked poses bear witness for the state, and how much each is worth.

A tracker judges a pose by colours that it learnt at that very pose, so it is as sure of a wrong place as
of the right one; how often the detector found the part there tells them apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from asdfviz.datatypes import PoseEstimate
from asdfviz.methods.track_memory import Track

TRUSTED = 0.8
"""A pose that is trusted less teaches neither a part's colours nor where it sits in its joint, and says
nothing of where the base is."""


@dataclass(frozen=True, slots=True, eq=False)
class Witnesses:
    """Poses by what they may tell."""

    trusted: dict[str, PoseEstimate]
    """Those that may be believed."""
    places: dict[str, PoseEstimate]
    """Those that tell of the state by where they are, scored by what they are worth."""
    loose: dict[str, PoseEstimate]
    """The same as they are tracked: what is doubted is not gone."""


def witnesses(
    poses: Mapping[str, PoseEstimate], tracks: Mapping[str, Track], *, base: str
) -> Witnesses:
    """Sort the poses of a frame.

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
    loose = {name: pose for name, pose in poses.items() if pose.stage != "group"}
    return Witnesses(
        trusted={name: pose for name, pose in poses.items() if trust[name] >= TRUSTED},
        places={n: replace(p, score=trust[n] * p.score) for n, p in loose.items()},
        loose=loose,
    )
