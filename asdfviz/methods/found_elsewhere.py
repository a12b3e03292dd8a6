"""What is found elsewhere of parts that the state holds.

Not in the paper. What the state holds together cannot bear witness for it, so a state that is wrong could
last: of a pin that is told to be in the jaw, which hides it, what is found on the table would be nobody's.
Of like parts that is one that the state leaves loose, as long as there are such; else it speaks against the
state.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import point_distance
from asdfviz.methods.track_memory import Track
from asdfviz.state.relative_pose import PlaceOdds
from asdfviz.state.twins import FOLLOWED, twin_groups

FIRST_PLACES = PlaceOdds()
"""What the score of a first pose says of its place."""


def names_of_loose(
    found: Mapping[str, Transform], tracks: Mapping[str, Track], assembly: Assembly
) -> dict[str, str]:
    """From the names to be changed to the new ones: a permutation, by which twins far from where they are held
    go by the names of loose ones that were not found.

    Args:
        found: T_camera_part in a new frame.
        tracks: what is known of the parts.
        assembly: whose parts.
    """
    changes: dict[str, str] = {}
    for names in twin_groups(assembly):
        middle = assembly.parts[names[0]].middle
        far = [
            n
            for n in names
            if n in found and _is_held(n, tracks) and not _are_near(found[n], tracks[n], middle)
        ]
        loose = [n for n in names if n not in found and not _is_held(n, tracks)]
        for old, new in zip(far, loose, strict=False):
            changes |= {old: new, new: old}
    return changes


def against_held(
    found: Mapping[str, PoseEstimate], tracks: Mapping[str, Track], assembly: Assembly
) -> dict[str, PoseEstimate]:
    """The poses of parts that are held but not seen there, found where none like them is tracked.

    Scored by how probably the part is there, as tracked ones are.
    """
    elsewhere: dict[str, PoseEstimate] = {}
    for names in twin_groups(assembly):
        middle = assembly.parts[names[0]].middle
        known = [tracks[n] for n in names if n in tracks]
        for name in names:
            if name not in found or not _is_held(name, tracks) or not tracks[name].unsure:
                continue
            if not any(_are_near(found[name].T_camera_part, track, middle) for track in known):
                pose = found[name]
                elsewhere[name] = replace(pose, score=FIRST_PLACES.probability(pose.score))
    return elsewhere


def _is_held(name: str, tracks: Mapping[str, Track]) -> bool:
    return name in tracks and tracks[name].joined


def _are_near(T_camera_part: Transform, track: Track, middle: Vector) -> bool:
    return point_distance(T_camera_part, track.T_now, middle) < FOLLOWED
