"""What stands out of a table, on depth images made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.shapes import Box, Depth
from asdfviz.pose.blobs import BlobConfig, heights_above, standing_out
from asdfviz.pose.table import largest_plane

K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])


def table(tilt: float = 0.3, noise: float = 0.0005) -> np.ndarray:
    """A tilted plane 0.7 m away, with noise."""
    v, u = np.mgrid[:240, :320]
    x, y = (u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]
    depth = 0.7 / (1 + tilt * y + 0.1 * x)
    return (depth + np.random.default_rng(0).normal(size=depth.shape) * noise).astype(np.float32)


def found_in(depth: Depth) -> list[Box]:
    config = BlobConfig()
    plane = largest_plane(depth, K, config=config.table)
    return standing_out(None if plane is None else heights_above(depth, K, plane), config=config)


def test_blobs_are_found_on_a_tilted_table_the_largest_first() -> None:
    depth = table()
    depth[50:70, 200:240] -= 0.03
    depth[150:160, 80:95] -= 0.008
    found = found_in(depth)
    assert len(found) == 2
    np.testing.assert_allclose(found[0], [199.5, 49.5, 239.5, 69.5], atol=1.5)
    np.testing.assert_allclose(found[1], [79.5, 149.5, 94.5, 159.5], atol=1.5)


def test_what_stands_in_a_ring_is_found_beside_it() -> None:
    depth = table()
    depth[60:120, 100:160] -= 0.03
    depth[70:110, 110:150] += 0.03
    depth[84:96, 124:136] -= 0.03
    ring, inside = found_in(depth)
    np.testing.assert_allclose(ring, [99.5, 59.5, 159.5, 119.5], atol=1.5)
    np.testing.assert_allclose(inside, [123.5, 83.5, 135.5, 95.5], atol=1.5)


@pytest.mark.parametrize("fault", ["too flat", "too small", "below", "too high", "hole"])
def test_what_is_no_part_is_left_out(fault: str) -> None:
    depth = table()
    size = 5 if fault == "too small" else 20
    change = {"too flat": -0.002, "below": 0.03, "too high": -0.3}.get(fault, -0.03)
    depth[100 : 100 + size, 100 : 100 + size] += change
    if fault == "hole":
        depth[100:120, 100:120] = 0
    assert found_in(depth) == []


def test_without_a_table_nothing_stands_out() -> None:
    rng = np.random.default_rng(1)
    clutter = rng.uniform(0.4, 3.0, (240, 320)).astype(np.float32)
    assert found_in(clutter) == []
    assert found_in(np.zeros((240, 320), np.float32)) == []
