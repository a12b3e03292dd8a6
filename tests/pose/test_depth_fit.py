from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from asdfviz.geometry.transforms import transform_from
from asdfviz.pose.confidence import ConfidenceConfig, confidence, confidence_held
from asdfviz.pose.depth_fit import depth_fit

K = np.array([[100.0, 0, 49.5], [0, 100.0, 49.5], [0, 0, 1]])
GRID = np.stack(np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.1, 0.1, 9)), -1).reshape(
    -1, 2
)
PLATE = np.column_stack([GRID, np.zeros(81)])
TOWARDS = np.tile([0.0, 0.0, -1.0], (81, 1))


def fit(z: float, depth: np.ndarray | None, normals: np.ndarray = TOWARDS):
    T_camera_part = transform_from(np.eye(3), np.array([0.0, 0.0, z]))
    return depth_fit(T_camera_part, PLATE, normals, depth=depth, K=K, margin=0.005)


def test_a_plate_at_its_place_fits_and_one_in_front_is_seen_through() -> None:
    wall = np.full((100, 100), 0.5, np.float32)
    assert fit(0.5, wall) == (1.0, 1.0, 1.0)
    assert fit(0.4, wall) == (0.0, 1.0, 0.0)
    assert fit(0.6, wall) == (0.0, 0.0, 0.0)  # all behind the wall: nothing speaks for it


def test_what_is_hidden_counts_less_than_what_is_seen_through() -> None:
    half = np.full((100, 100), 0.5, np.float32)
    half[:, :50] = 0.3
    hidden = fit(0.5, half)
    half[:, :50] = 0.7
    through = fit(0.5, half)
    assert hidden is not None
    assert through is not None
    assert hidden.share > through.share + 0.1
    assert hidden.visible < through.visible == 1.0
    assert hidden.agreeing == 1.0 > through.agreeing


def test_without_readings_or_a_front_nothing_is_said() -> None:
    assert fit(0.5, None) is None
    assert fit(0.5, np.zeros((100, 100), np.float32)) is None
    assert fit(0.5, np.full((100, 100), 0.5, np.float32), -TOWARDS) is None


WITNESSES = ("trust", "lead", "agreeing", "liked", "outline", "detection", "contours")


@pytest.mark.parametrize("better", WITNESSES)
def test_what_speaks_for_a_pose_makes_it_surer(better: str) -> None:
    seen: dict[str, Any] = dict.fromkeys(WITNESSES, 0.5)
    config = ConfidenceConfig(
        bias=-2.0, undetected=0.25, unsettled=0.5, **dict.fromkeys(WITNESSES, 1.0)
    )
    before = confidence(**seen, config=config)
    assert confidence(**{**seen, better: 0.9}, config=config) > before
    # Log odds: the bias and half of every weight.
    assert before == pytest.approx(1 / (1 + np.exp(2 - 3.5)))
    unseen = confidence(**{**seen, "detection": None}, config=config)
    assert unseen == pytest.approx(1 / (1 + np.exp(2 - 2.5 - 0.25)))  # its outline says nothing
    assert confidence(**seen, missed=True, config=config) == before  # it has a box
    missed = confidence(**{**seen, "detection": None}, missed=True, config=config)
    assert missed == pytest.approx(1 / (1 + np.exp(2 - 2.5 - 0.25 + config.missed)))
    unsettled = confidence(**{**seen, "contours": None}, config=config)
    assert unsettled == pytest.approx(1 / (1 + np.exp(2 - 3.0 - 0.5)))


def test_what_fits_with_others_is_surer() -> None:
    config = ConfidenceConfig(held=2.0)
    assert confidence_held(0.5, 1.0, config=config) == pytest.approx(1 / (1 + np.exp(-2.0)))
    sure = [confidence_held(p, 1.0, config=config) for p in (0.0, 0.2, 0.9, 1.0)]
    assert sure == sorted(sure)
    assert sure[0] < 1e-4
    assert sure[-1] == 1


def test_what_is_held_where_depth_has_something_else_is_doubted() -> None:
    config = ConfidenceConfig(held=2.0, elsewhere=5.0, half=0.4, unseen=0.7)
    sure = [confidence_held(0.5, fit, config=config) for fit in (0.0, 0.2, 0.4, 0.9, None)]
    # Log odds: what being held adds, without all, half, none of `elsewhere`; what hides says less.
    odds = np.array([-3.0, -0.5, 2.0, 2.0, 1.3])
    assert sure == pytest.approx((1 / (1 + np.exp(-odds))).tolist())
