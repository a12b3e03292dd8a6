"""A base and a block on a table, their depth drawn out to one side, or not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Frame, PoseEstimate, Stage
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.drawn_smear import Smear
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.seen_smear import SeenSmear, SmearConfig
from asdfviz.methods.told_poses import ToldPoses

POSES = {
    "base": transform_from(np.eye(3), np.array([0.06, 0.05, 0.74])),
    "block": transform_from(
        rotation_about(np.array([0.0, 0, 1.0]), 0.3), np.array([-0.05, -0.04, 0.73])
    ),
}
BLOCK = {"block": POSES["block"]}
PLAIN = Smear()


def frame(toy, smear: Smear, seed: int = 0) -> Frame:
    """Both on the toy's table, as a camera with this smear and a millimetre of noise has them."""
    shot = toy.frame(seed, POSES)
    depth = smear.applied(shot.depth.astype(np.float64), focal=float(shot.camera.K[0, 0]))
    depth += np.random.default_rng(seed).normal(size=depth.shape) * 1e-3
    return replace(shot, depth=depth.astype(np.float32))


def seen(
    toy,
    smear: Smear,
    *,
    looks: int = 6,
    poses: dict[str, Transform] | None = None,
    **options: Any,
) -> Smear:
    method = SeenSmear(toy.assembly.parts, config=SmearConfig(**options))
    for k in range(looks):
        method.see(frame(toy, smear, k), POSES if poses is None else poses)
    return method.now


@pytest.mark.parametrize("trail", [0.027, -0.02, 0.0])
def test_trails_are_found_on_either_side(toy, trail: float) -> None:
    """They are whole pixels: 8 and 6 at this focal length of 300."""
    now = seen(toy, Smear(trail=trail))
    assert abs(now.trail - trail) <= 0.5 / 300 + 0.005 / 2


def test_wider_edges_are_found(toy) -> None:
    assert seen(toy, Smear(deviation=0.0075)).deviation == 0.0055


def test_poses_that_are_a_little_off_tell_as_well(toy) -> None:
    off = transform_from(rotation_about(np.array([0.0, 0, 1.0]), 0.01), np.full(3, 1e-3))
    poses = {name: off @ T for name, T in POSES.items()}
    assert abs(seen(toy, Smear(trail=0.027), poses=poses).trail - 0.027) < 0.007


def test_one_look_tells_nothing_and_after_many_none_is_taken(toy) -> None:
    trailing = Smear(trail=0.027)
    assert seen(toy, trailing, looks=2, poses=BLOCK, least=3) == PLAIN
    assert seen(toy, trailing, looks=3, poses=BLOCK, least=3) != PLAIN
    method = SeenSmear(toy.assembly.parts, config=SmearConfig(looks=4))
    for k in range(4):
        method.see(frame(toy, PLAIN, k), BLOCK)
    for k in range(4, 30):
        method.see(frame(toy, trailing, k), POSES)
    assert method.now == PLAIN


def test_what_is_hidden_or_too_small_is_not_looked_at(toy) -> None:
    method = SeenSmear(toy.assembly.parts, config=SmearConfig(least=1))
    shot = frame(toy, Smear(trail=0.027))
    assert shot.depth is not None
    method.see(replace(shot, depth=None), POSES)
    method.see(replace(shot, depth=np.full_like(shot.depth, 0.3)), POSES)
    method.see(shot, {"block": transform_from(np.eye(3), np.array([0, 0, 30.0]))})
    assert method.now == PLAIN
    method.see(shot, BLOCK)
    assert method.now != PLAIN
    assert seen(toy, Smear(trail=0.027), side_px=(500.0, 900.0)) == PLAIN
    assert seen(toy, Smear(trail=0.027), enabled=False) == PLAIN


@pytest.mark.parametrize(
    ("stage", "score", "tells"),
    [("tracked", 0.9, True), ("tracked", 0.2, False), ("group", 0.9, False)],
)
def test_sure_poses_of_loose_parts_tell_it(toy, *, stage: Stage, score: float, tells: bool) -> None:
    shapes = part_shapes(toy.assembly, surface_points=900)
    told = ToldPoses(toy.assembly, shapes, AsdfTrackConfig())
    for k in range(6):
        poses = {n: PoseEstimate(n, T, score, stage) for n, T in POSES.items()}
        told.step(poses, frame(toy, Smear(trail=0.027), k), None)
    assert (told.smear.now != PLAIN) == tells


@pytest.mark.parametrize("wrong", [{"looks": 0}, {"least": 0}, {"gain": 1.0}])
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match="smear"):
        SmearConfig(**wrong)
