"""The toy's base on the table behind it, tilted or too deep, and a block held above it."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate, Stage
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.on_table import (
    NO_TABLE,
    OnTableConfig,
    none_below,
    on_table,
)
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.seen_table import ANY_TABLE, table_of

LYING = transform_from(np.eye(3), np.array([0.03, 0.02, 0.74]))
"""The base, 20 mm thick, on the toy's table 0.75 m away."""


def moved(turn: float, deeper: float) -> np.ndarray:
    R = rotation_about(np.array([1.0, 0.4, 0.0]), turn)
    return transform_from(R, LYING[:3, 3] * (1 + deeper / LYING[2, 3]))


def settled(
    toy,
    T: np.ndarray,
    name: str = "base",
    config: OnTableConfig | None = None,
    true: np.ndarray = LYING,
):
    frame = toy.frame(0, {"base": true})
    shapes = part_shapes(toy.assembly, surface_points=1500)
    poses = {name: PoseEstimate(name, T, 0.7, "refined")}
    found = on_table(poses, toy.assembly, shapes, frame, config=config or OnTableConfig())
    return found[name]


@pytest.mark.parametrize(("turn", "deeper"), [(0.1, 0.0), (0.0, 0.008), (0.12, 0.003)])
def test_what_lies_on_the_table_is_laid_flat_on_it(toy, turn: float, deeper: float) -> None:
    found = settled(toy, moved(turn, deeper))
    np.testing.assert_allclose(found.T_camera_part, LYING, atol=3e-3)
    assert found.score == 0.7
    assert found.stage == "refined"


def test_poses_stay_where_the_table_has_no_say(toy) -> None:
    tilted = moved(0.1, 0.0)
    assert np.array_equal(settled(toy, tilted, config=NO_TABLE).T_camera_part, tilted)
    held = transform_from(np.eye(3), np.array([0.0, 0.0, 0.6]))
    assert np.array_equal(settled(toy, held, "block").T_camera_part, held)
    frame = toy.frame(1)
    assert table_of(frame, ANY_TABLE) is None
    poses = {"base": PoseEstimate("base", tilted, 0.7, "refined")}
    shapes = part_shapes(toy.assembly, surface_points=300)
    assert on_table(poses, toy.assembly, shapes, frame, config=OnTableConfig()) == poses


@pytest.mark.parametrize(
    ("stage", "is_laid"), [("refined", True), ("tracked", True), ("group", False)]
)
def test_a_settled_pose_is_told_as_it_lies_but_for_what_the_state_holds(
    toy, stage: Stage, is_laid: bool
) -> None:
    """Twenty degrees off; thirty are too many."""
    tilted, steep = moved(0.35, 0.0), moved(0.52, 0.0)
    assert np.array_equal(settled(toy, steep).T_camera_part[:3, :3], steep[:3, :3])
    frame = toy.frame(0, {"base": LYING})
    shapes = part_shapes(toy.assembly, surface_points=1500)
    poses = {"base": PoseEstimate("base", tilted, 0.7, stage)}
    found = on_table(poses, toy.assembly, shapes, frame, config=OnTableConfig())["base"]
    np.testing.assert_allclose(found.T_camera_part, LYING if is_laid else tilted, atol=3e-3)


STEEP = transform_from(rotation_about(np.array([1.0, 0, 0]), 0.6), np.array([0.0, 0.0, 0.718]))
"""The base on edge, 1 mm above the table at most."""


def test_what_would_stand_in_the_table_is_lifted_where_it_does_not_lie_flat(toy) -> None:
    deep = STEEP.copy()
    deep[:3, 3] *= 1 + 0.02 / deep[2, 3]
    found = settled(toy, deep, true=STEEP).T_camera_part
    assert np.array_equal(found[:3, :3], deep[:3, :3])
    np.testing.assert_allclose(found[:3, 3], STEEP[:3, 3], atol=0.009)
    assert found[2, 3] < deep[2, 3] - 0.008


def test_nothing_is_lifted_against_what_depth_shows(toy) -> None:
    """In real frames small parts are measured as if they stood in the table."""
    deep = STEEP.copy()
    deep[:3, 3] *= 1 + 0.02 / deep[2, 3]
    assert np.array_equal(settled(toy, deep, true=deep).T_camera_part, deep)


def test_nothing_is_far_below_the_table_that_depth_does_not_show_there(toy) -> None:
    frame = toy.frame(0, {"base": LYING})
    assert frame.depth is not None
    frame.depth[:, :80] = 0.0  # where the depth camera sees nothing
    shapes = part_shapes(toy.assembly, surface_points=1500)
    unseen = {
        "base": LYING,
        "block": transform_from(np.eye(3), np.array([-0.75, 0.0, 1.8])),
        "pin": transform_from(np.eye(3), np.array([-0.3, 0.0, 0.72])),
    }
    poses = {name: PoseEstimate(name, T, 0.7, "refined") for name, T in unseen.items()}
    assert set(none_below(poses, shapes, frame)) == {"base", "pin"}
    # Where there are readings they are left to tell, and without a table nobody can.
    frame.depth[:, :80] = 0.75
    assert set(none_below(poses, shapes, frame)) == set(poses)
    assert set(none_below(poses, shapes, toy.frame(0))) == set(poses)
