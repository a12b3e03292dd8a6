"""The compiled readings against the definitions written out with arrays."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply, rotation_about, transform_from
from asdfviz.pose.depth_kernels import front_readings, ray_shifts
from asdfviz.pose.translation import NEAREST_SHARE, Weighting, weights_of

K = np.array([[80.0, 0.5, 31.5], [0.0, 84.0, 23.5], [0.0, 0.0, 1.0]])
CELLS, EDGE = 6, 0.02


def picture(rng: np.random.Generator) -> np.ndarray:
    """A slanted wall with holes and a step."""
    v, u = np.mgrid[:48, :64]
    depth = 0.5 + 0.001 * u + 0.0005 * v + 0.05 * (u > 40)
    return np.where(rng.random(depth.shape) < 0.1, 0.0, depth).astype(np.float32)


@pytest.mark.parametrize("seed", range(4))
def test_shifts_are_those_of_the_nearest_point_of_each_cell(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform([-0.15, -0.1, 0.4], [0.15, 0.1, 0.6], (300, 3))
    points[:5, 2] *= -1
    shift = np.array([0.002, -0.001, 0.01])
    box = np.array([10.0, 5.0, 70.0, 40.0]) + rng.uniform(-3, 3, 4)
    depth = picture(rng)
    found = ray_shifts(points, shift, K, depth, box, CELLS, EDGE)

    moved = points + shift
    pixels = project(moved, K)
    expected: list[float] = []
    for row in range(CELLS):
        for column in range(CELLS):
            low = box[:2] + (box[2:] - box[:2]) * [column, row] / CELLS
            high = box[:2] + (box[2:] - box[:2]) * [column + 1, row + 1] / CELLS
            inside = np.all((pixels >= low) & (pixels < high), axis=1)
            inside &= np.all((pixels >= 0) & (pixels <= [63, 47]), axis=1)
            if not inside.any():
                continue
            x = moved[inside][moved[inside][:, 2].argmin()]
            u, v = np.rint(project(x[None], K)[0]).astype(int)
            patch = depth[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2].astype(float)
            if depth[v, u] == 0 or patch.max() - patch[patch > 0].min() > EDGE:
                continue
            expected.append(float((depth[v, u] - x[2]) * np.linalg.norm(x) / x[2]))
    assert len(expected) > 10
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_front_readings_are_counted(seed: int) -> None:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = 0.05 * normals  # a ball
    T = transform_from(rotation_about(rng.normal(size=3), 1.0), np.array([0.02, 0.01, 0.56]))
    depth = picture(rng)
    count, on, before = front_readings(points[::2], normals[::2], T, K, depth, 0.006)

    seen = apply(T, points[::2])
    seen = seen[((seen * (normals[::2] @ T[:3, :3].T)).sum(axis=1) < 0)]
    u, v = np.rint(project(seen, K)).astype(int).T
    measured = depth[v, u].astype(float)
    gap = (measured - seen[:, 2])[measured > 0]
    assert (count, on, before) == (
        len(gap),
        np.count_nonzero(np.abs(gap) <= 0.006),
        np.count_nonzero(gap < -0.006),
    )
    assert 0 < on < count


def test_weight_functions_by_hand() -> None:
    shifts = np.array([0.0, 0.005, -0.01, 0.03])
    root = np.exp(-0.5)
    expected: dict[Weighting, list[float]] = {
        "gaussian": [1, root, root**4, root**36],
        "huber": [1, 1, 1 / 2, 1 / 6],
        "cauchy": [1, 1 / 2, 1 / 5, 1 / 37],
        "nearest": [1, 1, 0, 0],
        "uniform": [1, 1, 1, 1],
    }
    assert NEAREST_SHARE == 0.5
    for kind, weights in expected.items():
        np.testing.assert_allclose(weights_of(shifts, 0.005, kind=kind), weights)
    assert len(weights_of(shifts[:0], 0.005, kind="nearest")) == 0
