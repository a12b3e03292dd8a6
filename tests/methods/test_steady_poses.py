"""A block of the toy and its twin, found here and there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asdfviz.datatypes import PoseEstimate
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.steady_poses import SteadyPoses


def at(name: str, x: float, turn: float = 0.0) -> PoseEstimate:
    R = rotation_about(np.array([0.0, 0, 1]), turn)
    return PoseEstimate(name, transform_from(R, np.array([x, 0.0, 0.7])), 0.5, "refined")


def steady(toy, *, by_twins: bool = True) -> SteadyPoses:
    twin = replace(toy.assembly.parts["block"], name="twin")
    assembly = replace(toy.assembly, parts={**toy.assembly.parts, "twin": twin})
    return SteadyPoses(assembly, apart=0.006, by_twins=by_twins)


def told(counting: SteadyPoses, *poses: PoseEstimate) -> dict[str, int]:
    return counting.step({pose.part: pose.T_camera_part for pose in poses})


def test_frames_in_one_place_are_counted_whatever_the_twin_is_called(toy) -> None:
    counting = steady(toy)
    assert told(counting, at("block", 0.1), at("base", 0.3)) == {"block": 0, "base": 0}
    assert told(counting, at("twin", 0.102), at("base", 0.3)) == {"twin": 1, "base": 1}
    assert told(counting, at("block", 0.103), at("twin", 0.2)) == {"block": 2, "twin": 0}
    # Another part in the same place is not there still.
    assert told(counting, at("base", 0.103)) == {"base": 0}


def test_what_moves_or_was_away_for_a_frame_begins_anew(toy) -> None:
    counting = steady(toy)
    assert [told(counting, at("block", 0.1 + x))["block"] for x in (0, 0.005, 0.01, 0.02)] == [
        0,
        1,
        2,
        0,
    ]
    told(counting)
    assert told(counting, at("block", 0.12)) == {"block": 0}


def test_by_names_a_twin_is_another_part_unless_it_is_renamed(toy) -> None:
    counting = steady(toy, by_twins=False)
    told(counting, at("block", 0.1))
    assert told(counting, at("twin", 0.1)) == {"twin": 0}
    counting.rename({"twin": "block", "block": "twin"})
    assert told(counting, at("block", 0.1)) == {"block": 1}
