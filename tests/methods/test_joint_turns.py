"""A square pin that turns in the base is told as it is turned."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame, Joint, Mesh, PoseEstimate, Stage, State
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Axis, Symmetries, symmetric_angle
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods import joint_turns
from asdfviz.methods.joint_turns import JointTurns, JointTurnsConfig
from asdfviz.methods.part_poses import part_shapes

UP = np.array([0.0, 0, 1.0])
T_BASE_PIN = transform_from(np.eye(3), np.array([0.02, 0.0, 0.04]))
JOINT = Joint("revolute", UP, T_BASE_PIN[:3, 3], turn=(-np.pi, np.pi))


def about_z(degrees: float) -> Transform:
    return transform_from(rotation_about(UP, np.radians(degrees)), np.zeros(3))


SQUARE = Symmetries(discrete=tuple(about_z(angle) for angle in (90, 180, 270)))
ROUND = Symmetries(continuous=(Axis(UP, np.zeros(3)),))


@pytest.fixture
def pinned(assembly: Assembly) -> Assembly:
    """The toy, its pins four times symmetric."""
    pins = {n: replace(assembly.parts[n], symmetries=SQUARE) for n in ("pin", "pin-copy")}
    return replace(assembly, parts={**assembly.parts, **pins})


def state(joint: Joint = JOINT) -> State:
    return State(2, "pin", {"base": np.eye(4), "pin": T_BASE_PIN}, joints={"pin": joint})


class Seen:
    """The pin in the base, turned so far, and poses that are told of it."""

    def __init__(self, toy, assembly: Assembly, *, true: float, **options) -> None:
        self.T_camera_base = toy.poses(joined=True)["base"]
        self.assembly = assembly
        there = {"base": self.T_camera_base, "pin": self.turned(true)}
        plain = toy.frame(0, there)
        self.frame: Frame = replace(
            plain, depth=cv2.GaussianBlur(plain.depth, (0, 0), 0.0043 * 300)
        )
        self.shapes = part_shapes(assembly, surface_points=900)
        self.method = JointTurns(assembly, self.shapes, config=JointTurnsConfig(**options))

    def turned(self, degrees: float) -> Transform:
        return self.T_camera_base @ T_BASE_PIN @ about_z(degrees)

    def told(
        self,
        own: float,
        *,
        frames: int = 7,
        name: str = "pin",
        joins: State | None = None,
        stage: Stage = "group",
    ) -> PoseEstimate:
        poses = {
            "base": PoseEstimate("base", self.T_camera_base, 0.9, "group"),
            name: PoseEstimate(name, self.turned(own), 0.8, stage),
        }
        steps = [
            self.method.step(poses, self.frame, state() if joins is None else joins)
            for _ in range(frames)
        ]
        return steps[-1][name]

    def off(self, pose: PoseEstimate, true: float) -> float:
        angle = symmetric_angle(pose.T_camera_part, self.turned(true), SQUARE)
        return float(np.degrees(angle))


@pytest.mark.parametrize(("true", "own"), [(30.0, 0.0), (-20.0, 15.0), (40.0, 95.0)])
def test_it_is_told_as_it_is_turned(toy, pinned, true, own) -> None:
    seen = Seen(toy, pinned, true=true)
    first = seen.told(own, frames=1)
    assert seen.off(first, own) < 1e-3  # one look is not believed
    found = seen.told(own)
    assert seen.off(found, true) < 5.0
    assert (found.score, found.stage) == (0.8, "group")
    np.testing.assert_allclose(found.T_camera_part[:3, 3], seen.turned(own)[:3, 3], atol=1e-9)


def test_what_is_new_is_looked_at_in_every_frame_and_known_when_it_was_hidden(
    toy, pinned, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = list[int]()

    def liked(_: Frame, __: Mesh, turned: np.ndarray, **___: object) -> np.ndarray:
        looks.append(1)
        return np.eye(len(turned))[2]

    monkeypatch.setattr(joint_turns, "drawn_looks", liked)
    seen = Seen(toy, pinned, true=0.0, every=3, fresh=4)
    seen.told(0.0, frames=4)
    assert len(looks) == 4
    seen.told(0.0, frames=3)
    assert len(looks) == 5
    base = {"base": PoseEstimate("base", seen.T_camera_base, 0.9, "group")}
    for _ in range(3):  # a hand is before the pin
        seen.method.step(base, seen.frame, state())
    assert seen.off(seen.told(0.0, frames=1), 20.0) < 1.0
    assert len(looks) == 5


def test_what_stays_hidden_leaves_what_is_known_to_its_turn(
    toy, pinned, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A part of which too little is seen stays new: it alone is asked of in every frame."""
    places = {"base": np.eye(4), "pin": T_BASE_PIN, "pin-copy": T_BASE_PIN}
    joins = State(2, "pins", places, joints={"pin": JOINT, "pin-copy": JOINT})
    seen, asked = Seen(toy, pinned, true=0.0, every=3, fresh=2), list[str]()

    def look(name: str, *_: object) -> None:
        known = seen.method._seen[name]  # pyright: ignore[reportPrivateUsage]
        known.frame = len(asked)
        known.count += name == "pin"
        asked.append(name)

    monkeypatch.setattr(seen.method, "_look", look)
    poses = {n: PoseEstimate(n, seen.T_camera_base @ places[n], 0.8, "group") for n in places}
    for _ in range(24):
        seen.method.step(poses, seen.frame, joins)
    assert len(asked) == 24
    assert asked.count("pin") <= 2 + 24 // 3


@pytest.mark.parametrize(("height", "likes"), [(-0.3, 0.0), (-0.3, 60.0), (0.04, 60.0)])
def test_what_hangs_on_one_shaft_is_turned_by_one_turn(
    toy, pinned, monkeypatch: pytest.MonkeyPatch, *, height: float, likes: float
) -> None:
    """The second pin is out of sight, or looked at too: then it likes another turn, though less."""
    T_other = transform_from(np.eye(3), np.array([0.02, 0.0, height]))
    places = {"base": np.eye(4), "pin": T_BASE_PIN, "pin-copy": T_other}
    joins = State(2, "pins", places, joints={"pin": JOINT, "pin-copy": JOINT})
    meshes = {id(pinned.parts[name].mesh): name for name in ("pin", "pin-copy")}

    def liked(frame: Frame, mesh: Mesh, turned: np.ndarray, **_: object) -> np.ndarray:
        looks = np.zeros(len(turned))
        angle, weight = (30.0, 1.0) if meshes[id(mesh)] == "pin" else (likes, 0.6)
        looks[round(angle / 90 * len(turned)) % len(turned)] = weight
        return looks

    monkeypatch.setattr(joint_turns, "drawn_looks", liked)
    seen = Seen(toy, pinned, true=0.0, every=1)
    T = seen.T_camera_base
    poses = {n: PoseEstimate(n, T @ places[n], 0.8, "group") for n in places}
    told = [seen.method.step(poses, seen.frame, joins) for _ in range(12)][-1]
    assert seen.off(told["pin"], 30.0) < 1.0
    turned = np.linalg.inv(told["pin"].T_camera_part) @ told["pin-copy"].T_camera_part
    np.testing.assert_allclose(turned, np.linalg.inv(T_BASE_PIN) @ T_other, atol=1e-9)


def test_a_right_turn_stays_as_it_is(toy, pinned) -> None:
    seen = Seen(toy, pinned, true=30.0)
    assert np.array_equal(seen.told(30.0).T_camera_part, seen.turned(30.0))


def test_nothing_is_said_of_what_is_loose_rigid_or_round(toy, pinned) -> None:
    rigid = State(2, "pin", {"base": np.eye(4), "pin": T_BASE_PIN})
    slides = Joint("prismatic", UP, T_BASE_PIN[:3, 3], slide=(-0.01, 0.01))
    within = replace(JOINT, turn=(-0.5, 0.5))
    parts = {**pinned.parts, "pin": replace(pinned.parts["pin"], symmetries=ROUND)}
    cases: tuple[tuple[Assembly, State, Stage], ...] = (
        (pinned, state(), "tracked"),
        (pinned, rigid, "group"),
        (pinned, state(slides), "group"),
        (pinned, state(within), "group"),
        (replace(pinned, parts=parts), state(), "group"),
    )
    for assembly, joins, stage in cases:
        seen = Seen(toy, assembly, true=30.0)
        found = seen.told(0.0, joins=joins, stage=stage)
        assert np.array_equal(found.T_camera_part, seen.turned(0.0))


def test_turns_of_what_sweeps_far_are_not_compared(toy, pinned) -> None:
    """Where a long part is not, it would be taken for something before it."""
    beside = replace(JOINT, origin=JOINT.origin + np.array([0.05, 0, 0]))
    seen = Seen(toy, pinned, true=0.0)
    assert np.array_equal(seen.told(30.0, joins=state(beside)).T_camera_part, seen.turned(30.0))


def test_what_is_hidden_or_not_measured_says_nothing(toy, pinned) -> None:
    seen = Seen(toy, pinned, true=30.0)
    shown = seen.frame
    for depth in (None, np.full_like(shown.depth, 0.2)):
        seen.frame = replace(shown, depth=depth)
        assert np.array_equal(seen.told(0.0).T_camera_part, seen.turned(0.0))


def test_twins_that_change_names_take_their_turns_along(toy, pinned) -> None:
    seen = Seen(toy, pinned, true=30.0, every=1, enough=3)
    seen.told(0.0, frames=3)
    seen.method.rename({"pin": "pin-copy", "pin-copy": "pin"})
    placed = {"base": np.eye(4), "pin-copy": T_BASE_PIN}
    other = State(2, "pin", placed, joints={"pin-copy": JOINT})
    poses = seen.told(0.0, frames=1, name="pin-copy", joins=other)
    assert seen.off(poses, 30.0) < 5.0


def test_a_part_that_was_out_begins_anew(toy, pinned) -> None:
    seen = Seen(toy, pinned, true=30.0, every=1, enough=3)
    seen.told(0.0, frames=3)
    seen.told(0.0, frames=1, stage="tracked")
    assert seen.off(seen.told(0.0, frames=2), 0.0) < 1e-3


@pytest.mark.parametrize("wrong", [{"step_deg": 0.0}, {"every": 0}, {"enough": 0}, {"kept": 1.5}])
def test_an_option_out_of_range_is_named(wrong: dict[str, Any]) -> None:
    name = next(iter(wrong)).replace("_", "-")
    with pytest.raises(MethodError, match=f"{name.split('-')[0]}.*use"):
        JointTurnsConfig(**wrong)
