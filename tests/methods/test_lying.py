"""What lies on the table is told as it lies there, once two looks say so."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import Frame, PoseEstimate, Stage
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Symmetries, symmetric_angle
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from
from asdfviz.methods.lying import Lying, LyingConfig
from asdfviz.methods.on_table import NO_TABLE
from asdfviz.methods.part_poses import part_shapes
from asdfviz.pose.standing import sides, standing_on
from asdfviz.pose.table import Table


def told(toy, poses: dict[str, Transform], *, stage: Stage = "tracked") -> dict[str, PoseEstimate]:
    return {name: PoseEstimate(name, T, 0.9, stage) for name, T in poses.items()}


def lying(toy, **options) -> Lying:
    return Lying(
        toy.assembly,
        part_shapes(toy.assembly, surface_points=900),
        laid=NO_TABLE,
        config=LyingConfig(**options),
    )


def last(method: Lying, poses: dict[str, PoseEstimate], frame: Frame) -> dict[str, PoseEstimate]:
    """What is told in the last of eight frames that show the same."""
    return [method.step(poses, replace(frame, index=index)) for index in range(1, 9)][-1]


def askew(T: Transform, *, about: tuple[float, float, float], degrees: float) -> Transform:
    """Turned about an axis of the camera through the part's own origin."""
    R = rotation_about(np.array(about), np.radians(degrees))
    return transform_from(R @ T[:3, :3], T[:3, 3])


def angle(a: Transform, b: Transform) -> float:
    return float(np.degrees(rotation_angle(a[:3, :3].T @ b[:3, :3])))


@pytest.fixture
def scene(toy) -> tuple[dict[str, Transform], Frame]:
    """Base and block on the toy's table, 0.75 m away; depth is smeared as cameras smear it."""
    true = {
        "base": transform_from(np.eye(3), np.array([0.06, 0.05, 0.74])),
        "block": transform_from(
            rotation_about(np.array([0.0, 0, 1.0]), 0.3), np.array([-0.05, -0.04, 0.73])
        ),
    }
    frame = toy.frame(0, true)
    return true, replace(frame, depth=cv2.GaussianBlur(frame.depth, (0, 0), 0.0043 * 300))


@pytest.mark.parametrize(
    ("about", "degrees"), [((0.0, 0, 1.0), 24.0), ((1.0, 0, 0), 18.0), ((0.6, 0.3, 0.7), 25.0)]
)
def test_a_pose_that_is_askew_is_told_as_the_part_lies(toy, scene, about, degrees) -> None:
    true, frame = scene
    wrong = askew(true["block"], about=about, degrees=degrees)
    method, poses = lying(toy), told(toy, {"block": wrong})
    first = method.step(poses, frame)["block"]
    assert np.array_equal(first.T_camera_part, wrong)  # one look is not believed
    found = last(method, poses, frame)["block"]
    assert angle(found.T_camera_part, true["block"]) < 4.0
    assert np.linalg.norm((found.T_camera_part - true["block"])[:3, 3]) < 0.003
    assert (found.part, found.score, found.stage) == ("block", 0.9, "tracked")


def test_what_the_state_joins_does_not_lie(toy, scene) -> None:
    """Its base may be hidden, so that nothing places it: it hangs in the air all the same."""
    true, frame = scene
    wrong = askew(true["block"], about=(1.0, 0, 0), degrees=18.0)
    method, poses = lying(toy), told(toy, {"block": wrong})
    for index in range(1, 9):
        found = method.step(poses, replace(frame, index=index), joined={"base", "block"})
        assert found == poses


def test_it_is_found_where_its_tilted_pose_was_millimetres_beside_it(toy, scene) -> None:
    true, frame = scene
    wrong = askew(true["block"], about=(1.0, 0, 0), degrees=18.0)
    wrong[:2, 3] += (0.007, -0.005)
    found = last(lying(toy), told(toy, {"block": wrong}), frame)["block"]
    assert angle(found.T_camera_part, true["block"]) < 8.0
    assert np.linalg.norm((found.T_camera_part - true["block"])[:3, 3]) < 0.003


def test_what_a_smeared_rim_covers_by_millimetres_is_in_view(toy, scene) -> None:
    """Grooves of a small part are filled by the depth of what surrounds them."""
    true, frame = scene
    wrong = askew(true["block"], about=(0.0, 0, 1.0), degrees=24.0)
    is_part = cv2.erode((frame.depth < frame.depth.max() - 0.02).astype(np.uint8), np.ones((3, 3)))
    grooves = is_part * (np.arange(frame.depth.shape[1]) % 5 > 0)
    filled = (frame.depth - 0.012 * grooves).astype(np.float32)
    found = last(lying(toy), told(toy, {"block": wrong}), replace(frame, depth=filled))["block"]
    assert angle(found.T_camera_part, true["block"]) < 4.0


@pytest.mark.parametrize(("said", "stays"), [((1, 1, 0, 1, 1), True), ((1, 1, 0, 0, 0), False)])
def test_one_look_that_says_otherwise_is_not_believed(
    toy, scene, monkeypatch, said: tuple[int, ...], stays: bool
) -> None:
    true, frame = scene
    turned = transform_from(rotation_about(np.array([0.0, 0, 1.0]), 0.5), np.zeros(3))
    looks = iter(said)
    method = lying(toy, every=1, doubted=1, again=2)
    monkeypatch.setattr(method, "_lying", lambda *_: turned if next(looks, 0) else None)
    poses, found = told(toy, {"block": true["block"]}), list[float]()
    for index in range(6):
        pose = method.step(poses, replace(frame, index=index))["block"]
        found.append(angle(pose.T_camera_part, true["block"]))
    assert found[0] == pytest.approx(0, abs=1e-6)
    assert min(found[1:4]) > 20
    assert (found[-1] > 20) == stays


def test_what_moves_leaves_looks_for_what_lies_still(toy, scene, monkeypatch) -> None:
    true, frame = scene
    method, looks = lying(toy, every=1, doubted=3), list[str]()
    monkeypatch.setattr(method, "_lying", lambda part, *_: looks.append(part.name))
    for k in range(9):
        moving = true["block"].copy()
        moving[0, 3] += 0.01 * k
        poses = {"block": moving, "pin": true["block"]}
        method.step(told(toy, poses), replace(frame, index=k))
    assert looks.count("pin") == 2


def test_of_poses_that_look_the_same_any_may_come(toy, scene) -> None:
    """What was found in one of them holds in the others, whose axes look elsewhere."""
    true, frame = scene
    half = transform_from(rotation_about(np.array([0.0, 0, 1.0]), np.pi), np.zeros(3))
    block = replace(toy.assembly.parts["block"], symmetries=Symmetries(discrete=(half,)))
    method = Lying(
        replace(toy.assembly, parts={**toy.assembly.parts, "block": block}),
        part_shapes(toy.assembly, surface_points=900),
        laid=NO_TABLE,
        config=LyingConfig(),
    )
    wrong = askew(true["block"], about=(1.0, 0, 0), degrees=18.0)
    last(method, told(toy, {"block": wrong}), frame)
    found = method.step(told(toy, {"block": wrong @ half}), replace(frame, index=9))["block"]
    off = symmetric_angle(found.T_camera_part, true["block"], block.symmetries)
    assert np.degrees(off) < 4.0


def test_a_right_pose_and_what_is_held_stay(toy, scene) -> None:
    true, frame = scene
    wrong = askew(true["block"], about=(0.0, 0, 1.0), degrees=24.0)
    for poses in (
        told(toy, {"block": true["block"]}),
        told(toy, {"block": wrong}, stage="group"),
        told(toy, {"base": askew(true["base"], about=(0.0, 0, 1.0), degrees=24.0)}),
    ):
        found = last(lying(toy), poses, frame)
        for name, pose in poses.items():
            assert angle(found[name].T_camera_part, pose.T_camera_part) < 3.0


def test_end_for_end_is_left_to_others(toy, scene) -> None:
    true, frame = scene
    turned = askew(true["block"], about=(0.0, 0, 1.0), degrees=150.0)
    found = last(lying(toy), told(toy, {"block": turned}), frame)["block"]
    assert angle(found.T_camera_part, turned) <= LyingConfig().turned_deg


def test_nothing_is_said_of_what_is_in_the_air_hidden_or_not_measured(toy, scene) -> None:
    true, frame = scene
    wrong = askew(true["block"], about=(0.0, 0, 1.0), degrees=24.0)
    up = wrong.copy()
    up[2, 3] -= 0.08
    covered = frame.depth.copy()
    covered[:] = np.where(covered > 0, 0.3, 0)
    for pose, shown in (
        (up, frame),
        (wrong, replace(frame, depth=None)),
        (wrong, replace(frame, depth=covered)),
    ):
        found = last(lying(toy), told(toy, {"block": pose}), shown)["block"]
        assert np.array_equal(found.T_camera_part, pose)


def test_it_is_looked_at_seldom_while_it_lies_still(toy, scene, monkeypatch) -> None:
    true, frame = scene
    wrong = askew(true["block"], about=(0.0, 0, 1.0), degrees=24.0)
    method, looks = lying(toy, doubted=2, again=9, every=1), list[int]()
    real = method._lying
    monkeypatch.setattr(method, "_lying", lambda *a: (looks.append(a[2].index), real(*a))[1])
    told_at = [
        method.step(told(toy, {"block": wrong}), replace(frame, index=k))["block"]
        for k in range(20)
    ]
    assert looks == [0, 2, 11]
    assert np.array_equal(told_at[3].T_camera_part, told_at[10].T_camera_part)
    moved = wrong.copy()
    moved[0, 3] += 0.03
    method.step(told(toy, {"block": moved}), replace(frame, index=20))
    assert looks == [0, 2, 11, 20]


def test_a_side_is_set_down_on_the_table_along_the_ray(toy) -> None:
    part = toy.assembly.parts["block"]
    corners = part.mesh.vertices
    table = Table(np.array([0.0, 0, -1.0]), 0.8)
    T = askew(transform_from(np.eye(3), np.array([0.05, 0.02, 0.7])), about=(1.0, 0, 0), degrees=20)
    for down in sides(part.mesh):
        found = standing_on(T, down, corners, table)
        assert found is not None
        stood, tilt = found
        points = corners @ stood[:3, :3].T + stood[:3, 3]
        heights = points @ table.normal + table.offset
        assert heights.min() == pytest.approx(0.0, abs=1e-9)
        assert (stood[:3, :3] @ down) @ -table.normal == pytest.approx(1.0)
        assert tilt == pytest.approx(np.radians(angle(T, stood)), abs=1e-6)
        middle = corners.mean(axis=0)
        before, after = (P[:3, :3] @ middle + P[:3, 3] for P in (T, stood))
        assert np.cross(before, after) == pytest.approx(np.zeros(3), abs=1e-9)


def test_an_option_out_of_range_is_named() -> None:
    for make in (
        lambda: LyingConfig(sides=0),
        lambda: LyingConfig(refined=0),
        lambda: LyingConfig(every=0),
        lambda: LyingConfig(again=0),
        lambda: LyingConfig(doubted=0),
    ):
        with pytest.raises(MethodError, match="use 1 or more"):
            make()
