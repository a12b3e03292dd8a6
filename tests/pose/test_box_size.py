from __future__ import annotations

import numpy as np
import pytest

from asdfviz.pose.box_size import BoxSizes, measured_share

K = np.array([[500.0, 0, 159.5], [0, 500.0, 119.5], [0, 0, 1]])
ROD = np.array([[x, y, z] for x in (-0.05, 0.05) for y in (-0.002, 0.002) for z in (-0.002, 0.002)])
SIZES = BoxSizes.of({"rod": ROD, "pin": ROD / 4})


def box(width: float, height: float) -> np.ndarray:
    return np.array([160 - width / 2, 120 - height / 2, 160 + width / 2, 120 + height / 2])


def test_the_largest_box_of_a_rod_is_about_its_length() -> None:
    assert SIZES.largest["rod"] == pytest.approx(0.1, rel=0.06)
    assert SIZES.largest["pin"] == pytest.approx(SIZES.largest["rod"] / 4)


def test_a_box_may_be_smaller_than_a_part_but_not_larger() -> None:
    depth = np.full((240, 320), 0.5, np.float32)  # a metre is 1,000 px there
    for name, length in (("rod", 100), ("pin", 25)):
        assert name in SIZES.fitting(box(length, 4), depth=depth, K=K)
        assert name in SIZES.fitting(box(length / 3, 4), depth=depth, K=K)
        assert name not in SIZES.fitting(box(1.5 * length, 4), depth=depth, K=K)


def test_the_same_box_is_larger_farther_away() -> None:
    near, far = (np.full((240, 320), z, np.float32) for z in (0.4, 1.0))
    assert "rod" in SIZES.fitting(box(90, 4), depth=near, K=K)
    assert "rod" not in SIZES.fitting(box(90, 4), depth=far, K=K)


def test_a_bow_is_as_near_as_its_rim_not_as_what_shows_within() -> None:
    depth = np.full((240, 320), 1.0, np.float32)
    depth[118:122, 115:205] = 0.4
    depth[118:122, 135:185] = 1.0
    assert "rod" in SIZES.fitting(box(90, 4), depth=depth, K=K)
    depth[118:122, 115:130] = 1.0
    depth[118:122, 195:205] = 1.0
    assert "rod" not in SIZES.fitting(box(90, 4), depth=depth, K=K), "a little may be in front"


def test_without_a_reading_every_box_is_small_enough() -> None:
    whole = box(300, 200)
    assert "pin" in SIZES.fitting(whole, depth=None, K=K)
    assert "pin" in SIZES.fitting(whole, depth=np.zeros((240, 320), np.float32), K=K)


def test_readings_beside_the_picture_are_none() -> None:
    depth = np.full((240, 320), 0.5, np.float32)
    assert "pin" in SIZES.fitting(whole := box(300, 200) - 1000, depth=depth, K=K)
    assert "pin" in SIZES.fitting(whole + 5000, depth=depth, K=K)


def test_what_is_measured_of_a_box_counts_what_is_around_it() -> None:
    depth = np.full((240, 320), 0.5, np.float32)
    depth[:, :200] = 0.0
    assert measured_share(np.array([20.0, 20, 60, 60]), depth) == 0
    beside = measured_share(np.array([150.0, 20, 198, 60]), depth)
    assert 0.1 < beside < 0.2, "a dark part on a table"
    assert measured_share(np.array([240.0, 20, 280, 60]), depth) == 1
    assert measured_share(np.array([400.0, 20, 480, 60]), depth) == 0, "out of the picture"
