"""A block on a table, taken to be tilted, too deep or above it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from asdfviz.datatypes import Mesh
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import apply, rotation_about, rotation_angle, transform_from
from asdfviz.pose.standing import RestConfig, Stance, StandingConfig, laid_flat, lifted, sides
from asdfviz.pose.table import SunkConfig, Table

BOX = trimesh.creation.box((0.06, 0.04, 0.02))
MESH = Mesh(np.asarray(BOX.vertices, np.float64), np.asarray(BOX.faces, np.int32))
CORNERS = MESH.vertices
K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
NORMAL = np.array([0.0, 0.3, -1.0]) / np.linalg.norm([0.0, 0.3, -1.0])
TABLE = Table(NORMAL, 0.6)
DEPTH = np.full((240, 320), 0.5, np.float32)
LYING = transform_from(
    np.stack([np.array([1.0, 0, 0]), np.cross(NORMAL, [1.0, 0, 0]), NORMAL], axis=1),
    -0.59 * NORMAL,
)
"""On its largest side, 10 mm under its middle."""


def heights(T: np.ndarray) -> np.ndarray:
    return apply(T, CORNERS) @ NORMAL + 0.6


def flat(T: np.ndarray) -> np.ndarray | None:
    return laid_flat(T, sides(MESH), CORNERS, TABLE, config=StandingConfig())


def test_a_block_has_six_sides() -> None:
    found = {tuple(np.round(down, 6)) for down in sides(MESH)}
    assert len(found) == 6
    assert {tuple(s * axis) for axis in np.eye(3) for s in (1, -1)} == found


def test_a_round_rim_has_all_of_its_sides() -> None:
    """Also those that no throw of a generator ends on."""
    made = trimesh.creation.cylinder(0.02, 0.03, sections=24)
    mesh = Mesh(np.asarray(made.vertices, np.float64), np.asarray(made.faces, np.int32))
    found = sides(mesh)
    assert len(found) == 24 + 2
    around = np.degrees(np.sort(np.arctan2(*found[np.abs(found[:, 2]) < 0.1, :2].T)))
    np.testing.assert_allclose(np.diff(around), 15.0, atol=1e-6)


def test_a_flat_thing_has_two_sides() -> None:
    corners = np.array([[0.0, 0, 0], [0.05, 0, 0], [0.05, 0.03, 0], [0, 0.03, 0]])
    found = sides(Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32)))
    np.testing.assert_allclose(np.sort(found[:, 2]), [-1.0, 1.0], atol=1e-6)


@pytest.mark.parametrize("rise", [-0.003, -0.006, -0.012])
def test_a_block_that_nearly_lies_there_is_laid_flat_where_it_is_seen(rise: float) -> None:
    tilt = transform_from(rotation_about(np.array([0.3, 1.0, 0.0]), 0.15), np.zeros(3))
    T = LYING @ tilt
    T[:3, 3] += (rise - heights(T).min()) * NORMAL
    found = flat(T)
    assert found is not None
    lowest = np.sort(heights(found))[:4]
    np.testing.assert_allclose(lowest, lowest[0], atol=1e-6)
    assert -0.001 - 1e-6 < lowest[0] < 0.003
    assert rotation_angle(found[:3, :3].T @ T[:3, :3]) == pytest.approx(0.15, abs=0.01)
    np.testing.assert_allclose(found[:2, 3] / found[2, 3], T[:2, 3] / T[2, 3], atol=1e-9)


@pytest.mark.parametrize("case", ["tilted", "held", "deep"])
def test_what_does_not_lie_there_stays(case: str) -> None:
    T = LYING.copy()
    if case == "tilted":
        T = T @ transform_from(rotation_about(np.array([1.0, 0, 0]), 0.5), np.zeros(3))
    T[:3, 3] += {"held": 0.008, "deep": -0.03}.get(case, 0.0) * NORMAL
    assert flat(T) is None


def test_a_part_in_the_table_is_lifted_along_its_ray() -> None:
    T = LYING.copy()
    T[:3, 3] -= 0.012 * NORMAL
    config = SunkConfig()
    found = lifted(T, CORNERS, TABLE, depth=DEPTH, K=K, sunk=config, config=StandingConfig())
    assert found is not None
    free = config.free + config.free_share * float(np.linalg.norm([0.06, 0.04, 0.02]))
    assert heights(found).min() == pytest.approx(-free, abs=1e-6)
    np.testing.assert_allclose(found[:2, 3] / found[2, 3], T[:2, 3] / T[2, 3], atol=1e-9)
    assert (
        lifted(LYING, CORNERS, TABLE, depth=DEPTH, K=K, sunk=config, config=StandingConfig())
        is None
    )
    T[:3, 3] -= 0.03 * NORMAL
    assert lifted(T, CORNERS, TABLE, depth=DEPTH, K=K, sunk=config, config=StandingConfig()) is None


@pytest.mark.parametrize(
    ("tilt_deg", "rise", "said"),
    [
        (0, 0.0, 0.1),
        (10, 0.0, 0.05),
        (25, 0.0, 0.0),
        (0, 0.03, 0.0),
        (0, -0.008, 0.1 - 0.5 * 0.5355),
    ],
)
def test_the_table_speaks_for_what_lies_on_it(tilt_deg: float, rise: float, said: float) -> None:
    T = LYING @ transform_from(
        rotation_about(np.array([0, 1.0, 0]), np.deg2rad(tilt_deg)), np.zeros(3)
    )
    T[:3, 3] += (rise - heights(T).min()) * NORMAL
    stance = Stance(CORNERS, sides(MESH), SunkConfig(), RestConfig())
    both = np.stack([T, LYING])
    found = stance.in_favour(both, TABLE) - stance.against(both, TABLE, depth=DEPTH, K=K)
    assert found == pytest.approx([said, 0.1], abs=2e-3)
    nowhere = Stance(CORNERS, np.zeros((0, 3)), SunkConfig(), RestConfig())
    assert nowhere.against(LYING[None], TABLE, depth=DEPTH, K=K) == pytest.approx([0.0])
    assert nowhere.in_favour(LYING[None], TABLE) == pytest.approx([0.0])


def test_limits_out_of_range_are_named() -> None:
    with pytest.raises(MethodError, match="standing"):
        StandingConfig(lift=-1.0)
    with pytest.raises(MethodError, match="rest"):
        RestConfig(tilt_deg=0.0)
