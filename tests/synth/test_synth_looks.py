"""What makes the surfaces look real: folds, pale corners, smooth hands, a lens soft in its corners."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from jaxtyping import Float64

from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Points
from asdfviz.synth.description import Finish, Light, Placed, Scene
from asdfviz.synth.fractals import fractal
from asdfviz.synth.gbuffer import Views, build_gbuffer, place_all
from asdfviz.synth.implicit import mesh_implicit
from asdfviz.synth.kinect import camera_for
from asdfviz.synth.looks import theatre
from asdfviz.synth.mesh_bank import MeshBank
from asdfviz.synth.patterns import MACRO
from asdfviz.synth.render import render
from asdfviz.synth.sensor import RgbSensor, metered, photograph
from asdfviz.synth.shading import interreflected, look_at


@pytest.mark.parametrize("base", [2, 5, 48])
def test_noise_goes_on_over_its_border(base: int) -> None:
    plane = fractal(np.random.default_rng(1), 256, base=base, octaves=2)
    assert plane.mean() == pytest.approx(0.0, abs=1e-5)
    assert plane.std() == pytest.approx(1.0, abs=1e-4)
    for across in (plane, plane.T):
        seam, steps = np.abs(across[0] - across[-1]), np.abs(np.diff(across, axis=0))
        assert seam.max() < 1.2 * steps.max()


def test_folds_of_the_drape_are_steps_of_slope_along_whole_lines() -> None:
    height = MACRO["drape"](np.random.default_rng(3), 512)[:, :, 3]
    slope = np.gradient(height, 1 / 512, axis=1)
    # Folds run along the rows' normal: what they share over a hundred rows stands out of the rest.
    shared = slope[200:300].mean(axis=0)
    step = np.abs(shared[6:] - shared[:-6])
    assert step.max() > 0.1
    assert step.max() > 5 * np.median(step)


def test_the_drape_strays_slowly_in_hue_and_tone() -> None:
    drape = MACRO["drape"](np.random.default_rng(4), 256)
    hue = cv2.GaussianBlur(drape[:, :, 0], (0, 0), 6)
    assert hue.std() > 0.08
    assert 0.02 < drape[:, :, 2].std() < 0.12


@pytest.mark.parametrize("visible", [0.2, 0.5, 0.8])
def test_pale_corners_lose_less_light_than_dark_ones(visible: float) -> None:
    seen = torch.full((1, 1, 1, 1), visible)
    black, white = (interreflected(seen, torch.full((1, 1, 1, 3), a)).mean() for a in (0.02, 0.9))
    assert float(black) == pytest.approx(visible, abs=0.12)
    assert visible + 0.08 < float(white) <= 1.0


def test_meshes_of_implicit_surfaces_lie_on_them() -> None:
    def ball(points: Points) -> Float64[np.ndarray, "n"]:
        return np.linalg.norm(points, axis=1) - 0.02

    mesh = mesh_implicit(ball, np.full(3, -0.03), np.full(3, 0.03), step=0.006)
    assert np.abs(np.linalg.norm(mesh.vertices, axis=1) - 0.02).max() < 1e-4


def _contrast(image: np.ndarray, row: int, column: int) -> float:
    return float(image[row - 8 : row + 8, column - 8 : column + 8].std())


def test_a_soft_lens_blurs_corners_and_keeps_the_middle() -> None:
    y, x = np.mgrid[0:180, 0:320]
    board = np.repeat((0.2 + 0.3 * ((x + y) % 4 < 2))[:, :, None], 3, axis=2).astype(np.float32)
    lens = RgbSensor(exposure=metered(board), noise=0.0, vignette=0.0)
    sharp, soft = (
        photograph(board, sensor=replace(lens, softness_px=px), rng=np.random.default_rng(0))
        for px in (0.0, 6.0)
    )
    assert _contrast(soft, 90, 160) > 0.95 * _contrast(sharp, 90, 160)
    assert _contrast(soft, 10, 10) < 0.5 * _contrast(sharp, 10, 10)


def test_metered_light_is_left_as_it_is() -> None:
    gray = np.full((90, 160, 3), 0.3, np.float32)
    sensor = RgbSensor(exposure=metered(gray), noise=0.0, vignette=0.0, flare=0.0)
    image = photograph(gray, sensor=sensor, rng=np.random.default_rng(0))
    assert image[45, 80, 0] == pytest.approx(255 * 0.3 ** (1 / 2.2), abs=1)


def test_a_fold_swells_and_fades_along_its_line() -> None:
    height = MACRO["drape"](np.random.default_rng(3), 512)[:, :, 3]
    fine = np.abs(height - cv2.GaussianBlur(height, (0, 0), 3))
    column = int(fine.sum(axis=0).argmax())
    along = cv2.GaussianBlur(fine[:, column - 3 : column + 4].max(axis=1), (1, 41), 8)
    assert along.max() > 3 * along.min()


@pytest.mark.parametrize("seed", range(6))
def test_the_cloth_has_round_corners_and_bears_all_that_stands_on_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, 2)) * 0.1
    cloth = theatre(points, rng)[0]
    inside = points @ cloth.edges[:, :2].T <= cloth.edges[:, 2]
    assert inside.all()
    angles = np.sort(np.arctan2(cloth.edges[:, 1], cloth.edges[:, 0]))
    assert np.diff(angles).max() < np.deg2rad(50)


def test_a_wide_light_gives_a_broader_and_weaker_highlight() -> None:
    small, wide = (_highlight(radius) for radius in (0.02, 0.6))
    assert wide.max() < 0.8 * small.max()
    assert (wide > 0.5 * wide.max()).sum() > 1.3 * (small > 0.5 * small.max()).sum()


@pytest.mark.parametrize(("distance", "worn"), [(0.15, True), (1.5, False)])
def test_edges_are_worn_round_where_the_camera_is_near_enough(distance: float, worn: bool) -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y, z in ((-1, -1), (1, -1), (0, 0))])
    # A roof of two faces that meet at a right angle along x.
    faces = np.array([[0, 3, 5], [0, 5, 2], [4, 1, 2], [4, 2, 5]], np.int32)
    scene = _single(eye=np.array([0.0, 0.0, distance]), lights=(), zoom=6.0)
    bank = MeshBank.of([Mesh(0.03 * corners, faces)])
    views = Views.of([scene], scale=1.0, device="cpu")
    buffer = build_gbuffer([scene], place_all([scene], bank), views)
    upward = buffer.normal[..., 2][buffer.owner >= 0]
    assert bool((upward > 0.9).any()) == worn
    assert float(upward.median()) == pytest.approx(np.sqrt(0.5), abs=0.01)


def _single(*, eye: np.ndarray, lights: tuple[Light, ...], zoom: float = 1.0) -> Scene:
    """One black thing at the world's origin without ground or sky."""
    finish = Finish(color=np.full(3, 0.005), roughness=0.4)
    return Scene(
        camera=camera_for(160, 90, zoom=zoom),
        T_camera_world=look_at(eye, np.zeros(3)),
        placed=(Placed(0, np.eye(4), finish, "part"),),
        grounds=(),
        lights=lights,
        sky=np.zeros(3),
    )


def _highlight(radius: float) -> np.ndarray:
    """Brightness of a black ball under one light without any sky."""
    places = np.indices((48, 96)).reshape(2, -1).T * [np.pi / 47, 2 * np.pi / 96]
    polar, turn = places.T
    ball = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], 1)
    k = np.arange(48 * 96).reshape(48, 96)
    a, b, c, d = k[:-1], k[1:], np.roll(k, -1, 1)[1:], np.roll(k, -1, 1)[:-1]
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3).astype(np.int32)
    light = Light(np.array([0.8, 0.0, 1.5]), radius, np.ones(3))
    scene = _single(eye=np.array([0.0, 0.0, 0.4]), lights=(light,))
    bank = MeshBank.of([Mesh(0.05 * ball, faces)])
    picture = render([scene], bank, rng=np.random.default_rng(0))[0]
    return picture.radiance.mean(axis=2)
