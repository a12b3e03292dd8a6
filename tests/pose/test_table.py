"""The table in depth images made by hand, and parts that stand in it."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.pose.table import (
    SunkConfig,
    Table,
    TableConfig,
    depth_in_table,
    largest_plane,
    table_around,
)

K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
CUBE = 0.01 * np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(-1, 3).astype(float)


def tilted(tilt: float = 0.3) -> np.ndarray:
    """A tilted plane 0.7 m away on the axis."""
    v, u = np.mgrid[:240, :320]
    x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    return (0.7 / (1 + tilt * y + 0.1 * x)).astype(np.float32)


def table(depth: np.ndarray) -> Table:
    found = largest_plane(depth, K, config=TableConfig())
    assert found is not None
    return found


def placed(height: float, on: Table) -> np.ndarray:
    """The cube's pose with its middle so far above the table, its faces along the camera's axes."""
    z = (height - on.offset) / on.normal[2]
    return transform_from(np.eye(3), np.array([0.0, 0.0, z]))


def test_the_plane_is_found_under_what_stands_on_it() -> None:
    depth = tilted()
    depth[40:120, 80:200] -= 0.05
    on = table(depth)
    np.testing.assert_allclose(on.normal, -np.array([0.1, 0.3, 1.0]) / np.sqrt(1.1), atol=1e-3)
    assert on.offset == pytest.approx(0.7 / np.sqrt(1.1), abs=1e-3)


def test_no_plane_is_found_in_clutter_or_in_holes() -> None:
    clutter = np.random.default_rng(1).uniform(0.4, 3.0, (240, 320)).astype(np.float32)
    assert largest_plane(clutter, K, config=TableConfig()) is None
    assert largest_plane(np.zeros((240, 320), np.float32), K, config=TableConfig()) is None


def test_a_part_is_as_deep_in_the_table_as_its_lowest_corner() -> None:
    depth = tilted(0.0)
    on = table(depth)
    lowest = float((CUBE @ on.normal).min())
    Ts = np.stack([placed(h, on) for h in (0.05, 0.0, -0.02)])
    deep = depth_in_table(Ts, CUBE, on, depth=depth, K=K)
    np.testing.assert_allclose(deep, [0.0, -lowest, 0.02 - lowest], atol=1e-6)


def test_nothing_is_in_the_table_past_its_edge_or_outside_the_picture() -> None:
    depth = tilted()
    on = table(depth)
    past = depth.copy()
    past[:, 150:170] += 0.2
    sunk = placed(-0.02, on)
    assert depth_in_table(sunk[None], CUBE, on, depth=depth, K=K)[0] > 0.02
    assert depth_in_table(sunk[None], CUBE, on, depth=past, K=K)[0] == 0
    outside = sunk.copy()
    outside[0, 3] += 1.0
    assert depth_in_table(outside[None], CUBE, on, depth=depth, K=K)[0] == 0
    dark = depth.copy()
    dark[:, 150:170] = 0
    assert depth_in_table(sunk[None], CUBE, on, depth=dark, K=K)[0] > 0.02


def test_the_table_is_taken_at_the_height_that_it_has_around_a_box() -> None:
    depth = tilted(0.0)
    on, box = table(depth), np.array([20.0, 20, 60, 60])
    bent = depth.copy()
    bent[:100, :100] += 0.004
    bent[20:61, 20:61] -= 0.02
    near = table_around(box, on, depth=bent, K=K)
    assert near is not None
    assert near.offset - on.offset == pytest.approx(0.004, abs=1e-3)
    far = table_around(box + 150, on, depth=bent, K=K)
    assert far is not None
    assert far.offset == pytest.approx(on.offset, abs=1e-3)
    bent[:100, :100] = 0
    assert table_around(box, on, depth=bent, K=K) is None


def test_a_view_with_the_same_centre_sees_the_same_heights() -> None:
    on = table(tilted())
    R_camera_view = rotation_about(np.array([0.2, 1.0, 0.1]), 0.3)
    point = np.array([0.1, -0.05, 0.6])
    seen = on.seen_from(R_camera_view)
    height = point @ on.normal + on.offset
    assert R_camera_view.T @ point @ seen.normal + seen.offset == pytest.approx(height)


def test_slight_depths_say_nothing_and_large_ones_no_more_than_all() -> None:
    shares = SunkConfig().share(
        np.array([0.0, 0.005, 0.01, 0.5]), np.array([[0.0, 0, 0], [0.1, 0, 0]])
    )
    np.testing.assert_allclose(shares, [0, 0, 0.5, 1])


@pytest.mark.parametrize("wrong", [{"full_share": 0.0}, {"free": -0.001}])
def test_limits_out_of_range_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(MethodError, match="full_share must be above 0"):
        SunkConfig(**wrong)
