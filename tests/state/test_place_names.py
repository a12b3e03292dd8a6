from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.state.twins import PlaceNames, names_after, renamed, renamed_poses

T_CAMERA_BASE = transform_from(rotation_about(np.array([0.2, 1, 0]), 0.7), np.array([0.1, 0, 0.6]))
AWAY = transform_from(np.eye(3), np.array([0.3, 0.2, -0.1]))


@pytest.fixture
def pair(assembly: Assembly) -> Assembly:
    """The lid twice: the second one belongs 50 mm beside the first."""
    parts = {**assembly.parts, "lid-Copy": replace(assembly.parts["lid"], name="lid-Copy")}
    states = []
    for state in assembly.states:
        places = dict(state.T_base_part)
        if "lid" in places:
            shift = transform_from(np.eye(3), np.array([0.05, 0.0, 0.0]))
            places["lid-Copy"] = shift @ places["lid"]
        states.append(replace(state, T_base_part=places))
    return replace(assembly, parts=parts, states=tuple(states))


def seen(pair: Assembly, **places: np.ndarray) -> dict[str, np.ndarray]:
    """Poses in the camera frame; an underscore stands for the dash."""
    found = {"base": T_CAMERA_BASE}
    for key, T_base_part in places.items():
        found[key.replace("_", "-")] = T_CAMERA_BASE @ T_base_part
    return found


def test_a_twin_takes_the_name_of_its_place(pair: Assembly) -> None:
    places = pair.steps[-1].T_base_part
    swapped = {"lid": "lid-Copy", "lid-Copy": "lid"}
    names = PlaceNames(pair)
    assert names.changes(seen(pair, lid=AWAY, lid_Copy=places["lid"])) == swapped
    assert names.changes(seen(pair, lid=places["lid-Copy"], lid_Copy=places["lid"])) == swapped
    # The name changes hands though the other twin was not found.
    assert names.changes(seen(pair, lid_Copy=places["lid"])) == swapped


def test_names_stay_where_no_place_says_otherwise(pair: Assembly) -> None:
    places = pair.steps[-1].T_base_part
    names = PlaceNames(pair)
    assert names.changes(seen(pair, lid=places["lid"], lid_Copy=AWAY)) == {}
    assert names.changes(seen(pair, lid=AWAY, lid_Copy=AWAY)) == {}
    unseen_base = seen(pair, lid=AWAY, lid_Copy=places["lid"])
    del unseen_base["base"]
    assert names.changes(unseen_base) == {}


def test_what_the_base_holds_keeps_its_name(pair: Assembly) -> None:
    """Though the other twin comes near its place while its own pose is off, as a hand covers it."""
    places = pair.steps[-1].T_base_part
    names = PlaceNames(pair)
    off = seen(pair, lid=AWAY, lid_Copy=places["lid"])
    assert names.changes(off) != {}
    assert names.changes(off, held=("lid",)) == {}


def test_twins_are_followed_by_where_they_were(pair: Assembly) -> None:
    names = PlaceNames(pair)
    swapped = {"lid": "lid-Copy", "lid-Copy": "lid"}
    far, near = AWAY, transform_from(np.eye(3), np.array([0.0, -0.1, 0.05]))
    before = seen(pair, lid=near, lid_Copy=far)
    moved = transform_from(np.eye(3), np.array([0.01, 0.0, 0.02]))
    assert names.follows(seen(pair, lid=far @ moved, lid_Copy=near @ moved), before) == swapped
    assert names.follows(seen(pair, lid=near @ moved, lid_Copy=far @ moved), before) == {}
    # What is known of one settles both: the one that stays nobody was near.
    only = {"lid": before["lid"]}
    lost = transform_from(np.eye(3), np.array([-0.2, 0.3, 0.0]))
    assert names.follows(seen(pair, lid=lost, lid_Copy=near @ moved), only) == swapped
    assert names.follows(seen(pair, lid=lost, lid_Copy=far), only) == {}


def test_what_is_found_away_from_a_sure_part_is_its_lost_twin(pair: Assembly) -> None:
    names = PlaceNames(pair)
    swapped = {"lid": "lid-Copy", "lid-Copy": "lid"}
    place = transform_from(np.eye(3), np.array([0.0, -0.1, 0.05]))
    elsewhere = transform_from(np.eye(3), np.array([-0.2, 0.3, 0.0]))
    known = seen(pair, lid=place, lid_Copy=AWAY)
    found = seen(pair, lid=elsewhere)
    assert names.follows(found, known) == {}
    assert names.follows(found, known, sure=("lid",)) == swapped
    # Not if the twin is as sure, or found besides; and where it is known it is itself.
    assert names.follows(found, known, sure=("lid", "lid-Copy")) == {}
    both = seen(pair, lid=elsewhere, lid_Copy=AWAY)
    assert names.follows(both, known, sure=("lid",)) == {}
    assert names.follows(seen(pair, lid=place), known, sure=("lid",)) == {}


def test_parts_that_differ_keep_their_names(assembly: Assembly) -> None:
    places = assembly.steps[-1].T_base_part
    crossed = {"base": T_CAMERA_BASE, "lid": T_CAMERA_BASE @ places["block"]}
    assert PlaceNames(assembly).changes(crossed) == {}
    assert PlaceNames(assembly).follows(crossed, {"block": crossed["lid"]}) == {}


def test_values_and_poses_go_by_their_new_names() -> None:
    names = {"a": "b", "b": "a"}
    assert renamed({"a": 1, "c": 3}, names) == {"b": 1, "c": 3}
    poses = {"a": PoseEstimate("a", AWAY, 0.5, "pnp")}
    assert renamed_poses(poses, names)["b"].part == "b"


def test_two_changes_of_names_are_one() -> None:
    first, then = {"a": "b", "b": "a"}, {"b": "c", "c": "b"}
    names = names_after(first, then)
    assert names == {"a": "c", "b": "a", "c": "b"}
    values = {"a": 1, "b": 2, "c": 3}
    assert renamed(values, names) == renamed(renamed(values, first), then)
    assert names_after(first, first) == {}
    assert names_after({}, then) == names_after(then, {}) == then
