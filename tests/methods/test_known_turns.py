from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply_to_point, rotation_about, transform_from
from asdfviz.methods.base_votes import BaseVotes
from asdfviz.methods.base_votes_config import BaseVotesConfig
from asdfviz.methods.group_poses import GroupConfig, GroupPoses
from asdfviz.methods.known_turns import KnownTurns
from asdfviz.methods.part_poses import part_shapes
from asdfviz.state.relative_pose import RelativePoseConfig

HALF_TURN = transform_from(rotation_about(np.array([0.0, 0, 1]), np.pi), np.zeros(3))


class Turns:
    """Rules out what was asked for, and remembers it."""

    def __init__(self, *, allowed: bool) -> None:
        self.allowed = allowed
        self.asked: list[tuple[str, Transform, Transform]] = []

    def allows(self, frame: Frame, name: str, T_now: Transform, T_other: Transform) -> bool:
        self.asked.append((name, T_now, T_other))
        return self.allowed


class Votes(BaseVotes):
    """Remember how they were put right."""

    def __init__(self, assembly: Assembly) -> None:
        shapes = part_shapes(assembly, surface_points=100)
        group = GroupPoses(assembly, shapes, config=GroupConfig())
        super().__init__(group, places=RelativePoseConfig(), config=BaseVotesConfig())
        self.heard: list[Transform] = []

    def mended(self, T_camera_base: Transform) -> None:
        self.heard.append(T_camera_base)


def test_a_turn_that_was_ruled_out_is_put_right_where_the_part_is(toy) -> None:
    T_known = toy.poses(joined=False)["base"]
    moved = transform_from(np.eye(3), np.array([0.01, 0, 0])) @ T_known
    own = PoseEstimate("base", moved @ HALF_TURN, 0.6, "crop")
    turns = Turns(allowed=False)
    mended = KnownTurns(toy.assembly, turns).mended(own, T_known, toy.frame(0))
    middle = toy.assembly.parts["base"].middle
    assert np.allclose(mended.T_camera_part[:3, :3], T_known[:3, :3])
    there = apply_to_point(own.T_camera_part, middle)
    assert np.allclose(apply_to_point(mended.T_camera_part, middle), there)
    assert (mended.part, mended.score, mended.stage) == ("base", 0.6, "crop")
    ((name, T_now, T_other),) = turns.asked
    assert name == "base"
    assert np.array_equal(T_now, T_known)
    assert np.array_equal(T_other, own.T_camera_part)


@pytest.mark.parametrize("turns", [None, Turns(allowed=True), Turns(allowed=False)])
def test_else_it_stays_as_it_is(toy, turns: Turns | None) -> None:
    T = toy.poses(joined=False)["base"]
    own = PoseEstimate("base", T @ HALF_TURN, 0.6, "crop")
    is_known = turns is None or turns.allowed
    known = KnownTurns(toy.assembly, turns)
    assert known.mended(own, T if is_known else None, toy.frame(0)) is own


def test_the_votes_go_by_what_was_put_right(toy) -> None:
    T_known, frame = toy.poses(joined=False)["base"], toy.frame(0)
    told = PoseEstimate("base", T_known @ HALF_TURN, 0.6, "group")
    votes = Votes(toy.assembly)
    known = KnownTurns(toy.assembly, Turns(allowed=False))
    right = known.told(told, T_known, frame, votes)
    assert right is not None
    assert np.allclose(right.T_camera_part[:3, :3], T_known[:3, :3])
    assert len(votes.heard) == 1
    assert np.array_equal(votes.heard[0], right.T_camera_part)
    assert known.told(None, T_known, frame, votes) is None
    assert len(votes.heard) == 1
