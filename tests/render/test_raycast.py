from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Mesh
from asdfviz.geometry.transforms import apply, rotation_about, transform_from
from asdfviz.render.raycast import intersect

FORWARD = np.array([0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    ("origin", "direction", "expected"),
    [
        pytest.param((0, 0, -1), (0, 0, 1), 0.98, id="onto the near face"),
        pytest.param((0, 0, -1), (0, 0, 5), 0.98, id="length of the direction does not count"),
        pytest.param((0, 0, 0), (0, 0, 1), 0.02, id="from inside"),
        pytest.param((0, 0, -1), (0, 0, -1), None, id="away from it"),
        pytest.param((0.0501, 0, -1), (0, 0, 1), None, id="just past an edge"),
        pytest.param((0.0499, 0, -1), (0, 0, 1), 0.98, id="just inside an edge"),
        pytest.param((0, 0, -1), (1, 0, 0), None, id="along the faces"),
        pytest.param((-1, 0.01, 0.01), (1, 0, 0), 0.95, id="from the side"),
    ],
)
def test_against_a_box(
    box: Mesh,
    origin: tuple[float, ...],
    direction: tuple[float, ...],
    expected: float | None,
) -> None:
    found = intersect(
        np.array(origin, dtype=float), np.array(direction, dtype=float), box, np.eye(4)
    )
    assert found == (None if expected is None else pytest.approx(expected))


def test_against_the_sphere_equation() -> None:
    sphere = _sphere(0.1)
    rng = np.random.default_rng(5)
    T = transform_from(rotation_about(rng.normal(size=3), 1.0), np.array([0.1, -0.2, 1.0]))
    centre = T[:3, 3]
    for _ in range(40):
        origin = rng.normal(size=3) * 0.3
        aim = centre + rng.normal(size=3) * 0.06
        direction = (aim - origin) / np.linalg.norm(aim - origin)
        along = (centre - origin) @ direction
        off = np.sqrt(max((centre - origin) @ (centre - origin) - along**2, 0))
        if 0.095 < off < 0.1:
            continue
        found = intersect(origin, direction, sphere, T)
        if off >= 0.1:
            assert found is None
        else:
            assert found == pytest.approx(along - np.sqrt(0.01 - off**2), abs=1.5e-3)


def test_moving_ray_and_mesh_together_changes_nothing(box: Mesh) -> None:
    rng = np.random.default_rng(6)
    T_a_b = transform_from(rotation_about(rng.normal(size=3), 2.0), rng.normal(size=3))
    T_b_mesh = transform_from(rotation_about(rng.normal(size=3), 0.7), np.array([0, 0, 0.5]))
    origin_b = np.array([0.005, 0.01, 0.0])
    here = intersect(origin_b, FORWARD, box, T_b_mesh)
    origin_a = apply(T_a_b, origin_b[None])[0]
    there = intersect(origin_a, T_a_b[:3, :3] @ FORWARD, box, T_a_b @ T_b_mesh)
    assert here is not None
    assert there == pytest.approx(here)


def _sphere(radius: float) -> Mesh:
    steps = 48
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, steps), np.linspace(0, 2 * np.pi, steps), indexing="ij"
    )
    grid = radius * np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1
    )
    index = np.arange(steps * steps).reshape(steps, steps)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    faces = np.concatenate([np.stack(q, axis=-1).reshape(-1, 3) for q in ((a, b, c), (a, c, d))])
    return Mesh(grid.reshape(-1, 3), faces.astype(np.int32))
