"""A base that looks the same turned is told by the parts that are joined to it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from
from asdfviz.state.base_turns import BaseTurns
from asdfviz.state.fusion import Pose2State
from asdfviz.state.relative_pose import RelativePoseConfig, relative_pose_probabilities

Z = np.array([0.0, 0.0, 1.0])
HALF_TURN = transform_from(rotation_about(Z, np.pi), np.zeros(3))
TURNED = Symmetries(discrete=(HALF_TURN,))
ROUND = Symmetries(continuous=(Axis(Z, np.zeros(3)),))
FAR = transform_from(rotation_about(np.array([1.0, 1, 0]), 1.0), np.array([0.3, 0.2, -0.1]))


def with_base(assembly: Assembly, symmetries: Symmetries) -> Assembly:
    base = replace(assembly.parts["base"], symmetries=symmetries)
    return replace(assembly, parts={**assembly.parts, "base": base})


def scene(assembly: Assembly, state: int) -> dict[str, Transform]:
    """Every part where the state has it, the others far away."""
    return {name: assembly.states[state].T_base_part.get(name, FAR) for name in assembly.parts}


def turned(poses: Mapping[str, PoseEstimate], by: Transform) -> dict[str, PoseEstimate]:
    base = poses["base"]
    return {**poses, "base": replace(base, T_camera_part=base.T_camera_part @ by)}


def off(a: PoseEstimate, b: PoseEstimate) -> float:
    return rotation_angle(a.T_camera_part[:3, :3].T @ b.T_camera_part[:3, :3])


def about_z(angle: float) -> Transform:
    return transform_from(rotation_about(Z, angle), np.zeros(3))


@pytest.mark.parametrize("state", range(1, 5))
@pytest.mark.parametrize(("symmetries", "angle"), [(TURNED, np.pi), (ROUND, 2.0), (ROUND, -0.7)])
def test_every_state_is_recognised_whichever_equal_pose_the_base_has(
    assembly: Assembly, place: Callable, state: int, symmetries: Symmetries, angle: float
) -> None:
    assembly, config = with_base(assembly, symmetries), RelativePoseConfig()
    right = place(scene(assembly, state))
    told = BaseTurns(assembly, config=config).told(turned(right, about_z(angle)))
    said = relative_pose_probabilities(told, assembly, config=config)
    expected = relative_pose_probabilities(right, assembly, config=config)
    assert said is not None
    assert said == pytest.approx(expected, abs=0.02)
    assert {n: p for n, p in told.items() if n != "base"} == {
        n: p for n, p in right.items() if n != "base"
    }
    steps = Pose2State(assembly)
    ends = [steps.step(None, said) for _ in range(20)][-1]
    assert ends is not None
    assert ends.index == state


def test_one_turn_counts_for_all_parts(assembly: Assembly, place: Callable) -> None:
    """Each of two parts is where it belongs under another turn of the base: not both are joined."""
    assembly, config = with_base(assembly, TURNED), RelativePoseConfig()
    poses = scene(assembly, 2)
    poses["pin"] = HALF_TURN @ poses["pin"]
    # The hole on the other side is the error's, of which this is the place.
    steps = replace(assembly, states=assembly.states[:4])
    told = BaseTurns(steps, config=config).told(place(poses))
    said = relative_pose_probabilities(told, steps, config=config)
    assert said is not None
    assert int(said.argmax()) == 1


def test_a_base_without_symmetries_stays_bit_for_bit(assembly: Assembly, place: Callable) -> None:
    poses = turned(place(scene(assembly, 3)), HALF_TURN)
    told = BaseTurns(assembly, config=RelativePoseConfig()).told(poses)
    assert all(told[name] is pose for name, pose in poses.items())


def test_where_no_part_tells_the_base_is_turned_as_before(
    assembly: Assembly, place: Callable
) -> None:
    assembly = with_base(assembly, TURNED)
    turns, right = BaseTurns(assembly, config=RelativePoseConfig()), place(scene(assembly, 3))
    alone = {"base": turned(right, HALF_TURN)["base"]}
    # Before anything was told it stays as it is.
    assert off(turns.told(alone)["base"], alone["base"]) < 1e-9
    assert off(turns.told(right)["base"], right["base"]) < 1e-9
    assert off(turns.told(alone)["base"], right["base"]) < 1e-9
    assert "base" not in turns.told({"lid": right["lid"]})


def test_what_was_told_for_long_is_not_given_up_for_one_frame(
    assembly: Assembly, place: Callable
) -> None:
    assembly = with_base(assembly, TURNED)
    turns, right = BaseTurns(assembly, config=RelativePoseConfig()), place(scene(assembly, 1))
    other = turned(right, HALF_TURN)
    for _ in range(10):
        turns.told(right)
    # The block on the other side, as if the base had been turned about.
    T_other_side = other["base"].T_camera_part @ assembly.states[1].T_base_part["block"]
    wild = {**right, "block": replace(right["block"], T_camera_part=T_other_side)}
    assert off(turns.told(wild)["base"], right["base"]) < 1e-9
    told = [turns.told(wild) for _ in range(10)]
    assert off(told[-1]["base"], other["base"]) < 1e-9
