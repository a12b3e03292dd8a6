from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Camera
from asdfviz.render.renderer import Renderer
from asdfviz.render.visibility import visible_fractions


def at(x: float, z: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = x, 0, z
    return T


@pytest.fixture
def camera(K: np.ndarray) -> Camera:
    return Camera(K, 160, 120)


def test_no_poses_no_shares(renderer: Renderer, assembly: Assembly, camera: Camera) -> None:
    assert visible_fractions({}, assembly, camera, renderer=renderer) == {}


def test_alone_all_of_a_part_is_seen(
    renderer: Renderer, assembly: Assembly, camera: Camera
) -> None:
    shares = visible_fractions({"red": at(0, 0.4)}, assembly, camera, renderer=renderer)
    assert shares == {"red": 1.0}


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        pytest.param(0.0, 0.0, id="behind a larger-looking one"),
        pytest.param(0.3, 1.0, id="beside it"),
    ],
)
def test_another_part_hides(
    renderer: Renderer, assembly: Assembly, camera: Camera, x: float, expected: float
) -> None:
    poses = {"red": at(0, 0.4), "black": at(x, 0.8)}
    shares = visible_fractions(poses, assembly, camera, renderer=renderer)
    assert shares["red"] == 1.0
    assert shares["black"] == pytest.approx(expected)


def test_half_hidden(renderer: Renderer, assembly: Assembly, camera: Camera) -> None:
    # Front faces at 0.38 and 0.78: seen from the camera, the near box covers x < 0.05 / 0.38 * z.
    edge = 0.05 / 0.38 * 0.78
    poses = {"red": at(0, 0.4), "black": at(edge, 0.8)}
    share = visible_fractions(poses, assembly, camera, renderer=renderer)["black"]
    assert share == pytest.approx(0.5, abs=0.06)


def test_the_picture_border_hides(
    renderer: Renderer, assembly: Assembly, camera: Camera, open_renderer
) -> None:
    # The front face's middle lies on the left border.
    T = at((-0.5 - camera.K[0, 2]) / camera.K[0, 0] * 0.48, 0.5)
    share = visible_fractions({"red": T}, assembly, camera, renderer=renderer)["red"]
    # The same view with a border of 160 more pixels on the left shows all of it.
    K_larger = camera.K.copy()
    K_larger[0, 2] += 160
    with open_renderer(320, 120) as larger:
        _, ids = larger.depth_and_ids([assembly.parts["red"].mesh], [T], K_larger)
    expected = (ids[:, 160:] >= 0).sum() / (ids >= 0).sum()
    assert 0.4 < expected < 0.7
    assert share == pytest.approx(expected, abs=0.05)
    gone = visible_fractions({"red": at(5.0, 0.5)}, assembly, camera, renderer=renderer)
    assert gone == {"red": 0.0}


@pytest.mark.parametrize(
    ("measured", "expected"),
    [
        pytest.param(0.0, 1.0, id="hole"),
        pytest.param(0.38, 1.0, id="the part itself"),
        pytest.param(0.37, 1.0, id="within the tolerance"),
        pytest.param(0.30, 0.0, id="a hand in front"),
        pytest.param(1.00, 1.0, id="the table behind"),
    ],
)
def test_measured_depth_hides(
    renderer: Renderer, assembly: Assembly, camera: Camera, measured: float, expected: float
) -> None:
    depth = np.full((120, 160), measured, dtype=np.float32)
    shares = visible_fractions(
        {"red": at(0, 0.4)}, assembly, camera, depth=depth, renderer=renderer
    )
    assert shares["red"] == pytest.approx(expected)
