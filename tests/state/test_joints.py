from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Joint
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import apply, rotation_about, transform_from
from asdfviz.state.joints import deviation, nearest_in_joint

Z = np.array([0.0, 0.0, 1.0])
ORIGIN = np.array([0.05, 0.0, 0.0])
CENTER = np.array([0.0, 0.0, 0.02])
T_NOMINAL = transform_from(rotation_about(np.array([1.0, 0.5, 0]), 0.7), np.array([0.1, 0, 0.03]))


def moved(*, slide: float = 0.0, turn: float = 0.0, tilt: float = 0.0, side: float = 0.0):
    """The nominal pose moved in a joint about Z through ORIGIN, then off it."""
    R = rotation_about(Z, turn)
    T_motion = transform_from(R, ORIGIN - R @ ORIGIN + slide * Z)
    T = T_motion @ T_NOMINAL
    off = transform_from(rotation_about(np.array([1.0, 0, 0]), tilt), np.array([0.0, side, 0.0]))
    return off @ T


def left(T: np.ndarray, joint: Joint | None) -> tuple[float, float]:
    return deviation(T, T_NOMINAL, center_part=CENTER, symmetries=Symmetries(), joint=joint)


def joint(kind, slide=(-0.02, 0.04), turn=(-0.5, 1.5)) -> Joint:
    return Joint(kind, Z, ORIGIN, slide, turn)


@pytest.mark.parametrize(
    ("kind", "motion"),
    [
        ("prismatic", {"slide": 0.03}),
        ("prismatic", {"slide": -0.02}),
        ("revolute", {"turn": 1.2}),
        ("revolute", {"turn": -0.5}),
        ("cylindrical", {"slide": 0.03, "turn": 1.2}),
        ("cylindrical", {"slide": 0.0, "turn": 0.0}),
    ],
)
def test_motion_within_the_range_is_no_deviation(kind, motion) -> None:
    distance, angle = left(moved(**motion), joint(kind))
    assert distance < 1e-9
    assert angle < 1e-7
    if any(motion.values()):
        assert max(left(moved(**motion), None)) > 0.01


@pytest.mark.parametrize(
    ("kind", "motion", "distance", "angle"),
    [
        ("prismatic", {"slide": 0.07}, 0.03, 0.0),
        ("prismatic", {"slide": -0.05}, 0.03, 0.0),
        ("revolute", {"slide": 0.02}, 0.02, 0.0),
        ("cylindrical", {"slide": 0.05, "turn": 1.0}, 0.01, 0.0),
    ],
)
def test_what_leaves_the_range_is_left(kind, motion, distance, angle) -> None:
    assert left(moved(**motion), joint(kind)) == pytest.approx((distance, angle), abs=1e-7)


def test_a_turn_beyond_the_range_is_held_at_its_end() -> None:
    _, angle = left(moved(turn=2.0), joint("revolute"))
    assert angle == pytest.approx(0.5, abs=1e-7)


def test_a_full_turn_is_free_and_screws_may_turn_more_than_once() -> None:
    for turn in ((-np.pi, np.pi), (0.0, 6 * np.pi), (4.0, 5.5)):
        distance, angle = left(moved(turn=4.5), joint("revolute", turn=turn))
        assert distance < 1e-9
        assert angle < 1e-7


def test_a_ball_turns_any_way_within_its_limit() -> None:
    R = rotation_about(np.array([0.3, -1.0, 0.4]), 0.9)
    T = transform_from(R, ORIGIN - R @ ORIGIN) @ T_NOMINAL
    free = left(T, joint("ball", turn=(0.0, 0.0)))
    wide = left(T, joint("ball", turn=(-1.0, 1.0)))
    tight = left(T, joint("ball", turn=(-0.4, 0.4)))
    assert free == pytest.approx((0.0, 0.0), abs=1e-7)
    assert wide == pytest.approx((0.0, 0.0), abs=1e-7)
    assert tight[1] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("kind", ["prismatic", "revolute", "cylindrical"])
def test_what_is_off_the_axis_is_never_excused(kind) -> None:
    distance, angle = left(moved(side=0.03, tilt=0.4), joint(kind))
    assert distance > 0.01
    assert angle == pytest.approx(0.4, abs=1e-6)


def test_a_symmetric_part_may_be_turned_about_its_axis() -> None:
    spin = Symmetries(continuous=(Axis(Z, np.zeros(3)),))
    T_turned = T_NOMINAL @ transform_from(rotation_about(Z, 2.5), np.zeros(3))
    found = deviation(T_turned, T_NOMINAL, center_part=CENTER, symmetries=spin)
    assert found == pytest.approx((0.0, 0.0), abs=1e-7)
    assert deviation(
        T_turned, T_NOMINAL, center_part=CENTER, symmetries=Symmetries()
    ).angle == pytest.approx(2.5, abs=1e-7)


def test_the_distance_is_taken_at_the_parts_middle() -> None:
    far_frame = np.array([0.0, 0.0, 1.0])
    T_turned = T_NOMINAL @ transform_from(rotation_about(np.array([1.0, 0, 0]), 0.1), np.zeros(3))
    near = deviation(T_turned, T_NOMINAL, center_part=np.zeros(3), symmetries=Symmetries())
    far = deviation(T_turned, T_NOMINAL, center_part=far_frame, symmetries=Symmetries())
    assert near.distance < 1e-12
    assert far.distance == pytest.approx(2 * np.sin(0.05), abs=1e-9)


def test_the_nearest_pose_in_a_joint_is_reached_by_the_joint() -> None:
    T = moved(slide=0.02, turn=0.7, tilt=0.1, side=0.01)
    T_held = nearest_in_joint(T, T_NOMINAL, joint("cylindrical"), center_part=CENTER)
    assert left(T_held, joint("cylindrical")) == pytest.approx((0.0, 0.0), abs=1e-7)
    assert left(T, joint("cylindrical"))[0] < left(T, None)[0]


def test_of_poses_that_look_the_same_the_one_in_range_counts() -> None:
    """A wheel of two spokes, turned by -90 degrees in a joint that turns from -97 to 74."""
    turning = joint("revolute", turn=(np.deg2rad(-97), np.deg2rad(74)))
    half = transform_from(rotation_about(Z, np.pi), np.zeros(3))
    upright = transform_from(np.eye(3), ORIGIN)
    for degrees in (-95, -90, 0, 70, 85):
        T = transform_from(rotation_about(Z, np.deg2rad(degrees)), ORIGIN)
        off = deviation(
            T, upright, center_part=np.zeros(3), symmetries=Symmetries((half,)), joint=turning
        )
        assert np.degrees(off.angle) == pytest.approx(0, abs=1e-5), degrees


@pytest.mark.parametrize("kind", ["revolute", "cylindrical", "ball"])
def test_what_a_joint_allows_is_allowed_however_large_the_part_is(kind) -> None:
    T = moved(turn=1.2)
    for spread in (None, 0.002, 0.02, 1.0):
        T_held = nearest_in_joint(T, T_NOMINAL, joint(kind), center_part=CENTER, spread=spread)
        assert np.allclose(T_held, T, atol=1e-9)


@pytest.mark.parametrize("kind", ["revolute", "ball"])
def test_a_part_on_a_long_arm_is_turned_as_its_place_tells(kind) -> None:
    """It is seen in its place, but askew: by its rotation alone it would swing out of there."""
    arm = np.array([0.15, 0.0, 0.0])
    T_placed = transform_from(np.eye(3), ORIGIN + arm)
    askew = transform_from(rotation_about(Z, 0.1), T_placed[:3, 3])

    def swung(spread: float | None) -> float:
        T = nearest_in_joint(
            askew, T_placed, joint(kind, turn=(-1.0, 1.0)), center_part=np.zeros(3), spread=spread
        )
        return float(np.linalg.norm(T[:3, 3] - T_placed[:3, 3]))

    assert swung(None) == pytest.approx(2 * 0.15 * np.sin(0.05), abs=1e-9)
    assert swung(0.02) < 0.001
    assert swung(10.0) == pytest.approx(swung(None), abs=1e-4), (
        "a huge part shows its rotation best"
    )


def test_the_turn_is_the_one_after_which_all_points_are_nearest() -> None:
    """Against a search over all turns, with points that are spread as is said."""
    rng, spread = np.random.default_rng(5), 0.02
    cloud = rng.normal(size=(4000, 3))
    cloud = (cloud - cloud.mean(axis=0)) @ np.linalg.inv(np.linalg.cholesky(np.cov(cloud.T))).T
    points = CENTER + spread * cloud
    T = moved(turn=0.4, tilt=0.15, side=0.012)
    T_held = nearest_in_joint(T, T_NOMINAL, joint("revolute"), center_part=CENTER, spread=spread)

    def off(T_at: np.ndarray) -> float:
        return float(((apply(T_at, points) - apply(T, points)) ** 2).sum())

    tried = [moved(turn=turn) for turn in np.linspace(-0.5, 1.5, 401)]
    assert off(T_held) <= min(map(off, tried)) * (1 + 1e-4)
