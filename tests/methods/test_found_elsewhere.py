"""Two pins, and what is found of them while the state holds one or both."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.found_elsewhere import against_held, names_of_loose
from asdfviz.methods.track_memory import Track


def at(x: float) -> Transform:
    return transform_from(np.eye(3), np.array([x, 0.0, 0.6]))


IN, TABLE, HAND = at(0.0), at(0.2), at(-0.2)


def held(T: Transform, *, unsure: int = 4) -> Track:
    return Track(T, joined=True, unsure=unsure)


def seen(places: Mapping[str, Transform]) -> dict[str, PoseEstimate]:
    return {name: PoseEstimate(name, T, 0.7, "refined") for name, T in places.items()}


BOTH = {"pin": "pin-copy", "pin-copy": "pin"}


@pytest.mark.parametrize(
    ("found", "tracks", "changes"),
    [
        ({"pin": TABLE}, {"pin": held(IN)}, BOTH),
        ({"pin": TABLE}, {"pin": held(IN), "pin-copy": Track(HAND)}, BOTH),
        # Where it is held, or near there: it is the held one.
        ({"pin": at(0.03)}, {"pin": held(IN)}, {}),
        # The loose one was found, too, or there is none.
        ({"pin": TABLE, "pin-copy": HAND}, {"pin": held(IN)}, {}),
        ({"pin": TABLE}, {"pin": held(IN), "pin-copy": held(at(0.01))}, {}),
        # What is not held may be anywhere, and what has no twin keeps its name.
        ({"pin": TABLE}, {"pin": Track(IN)}, {}),
        ({"block": TABLE}, {"block": held(IN)}, {}),
    ],
)
def test_a_twin_found_far_from_where_it_is_held_is_a_loose_one(
    assembly: Assembly,
    found: Mapping[str, Transform],
    tracks: Mapping[str, Track],
    changes: Mapping[str, str],
) -> None:
    assert names_of_loose(found, tracks, assembly) == changes


@pytest.mark.parametrize(
    ("found", "tracks", "names"),
    [
        ({"block": TABLE}, {"block": held(IN)}, {"block"}),
        ({"block": at(0.03)}, {"block": held(IN)}, set[str]()),
        # It is seen where it is held.
        ({"block": TABLE}, {"block": held(IN, unsure=0)}, set[str]()),
        ({"block": TABLE}, {"block": Track(IN)}, set[str]()),
        # Both are held, and one lies on the table; unless that is where the other one is tracked.
        ({"pin": TABLE}, {"pin": held(IN), "pin-copy": held(at(0.01))}, {"pin"}),
        ({"pin": TABLE}, {"pin": held(IN), "pin-copy": Track(at(0.21))}, set[str]()),
    ],
)
def test_what_is_found_elsewhere_speaks_against_the_state(
    assembly: Assembly,
    found: Mapping[str, Transform],
    tracks: Mapping[str, Track],
    names: set[str],
) -> None:
    poses = seen(found)
    against = against_held(poses, tracks, assembly)
    assert set(against) == names
    for name, pose in against.items():
        assert pose.T_camera_part is poses[name].T_camera_part


def test_its_score_says_how_probably_the_part_is_there(assembly: Assembly) -> None:
    """A first pose that scores 0.3 has its part's place nine times in ten, one that scores 0.05 hardly ever."""
    likely = [
        against_held(
            {"block": PoseEstimate("block", TABLE, score, "refined")},
            {"block": held(IN)},
            assembly,
        )["block"].score
        for score in (0.05, 0.3, 0.7)
    ]
    assert likely[0] < 0.2
    assert likely[1] > 0.8
    assert likely[2] > 0.99
