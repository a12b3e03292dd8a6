from __future__ import annotations

import numpy as np
import pytest

from asdfviz.detector.letterbox import letterbox, plan_letterbox


@pytest.mark.parametrize(
    ("width", "height", "image_size", "stride", "wanted"),
    [
        (640, 360, 640, 32, (640, 384)),
        (1280, 720, 640, 32, (640, 384)),
        (640, 480, 640, 32, (640, 480)),
        (360, 640, 640, 32, (384, 640)),
        (1280, 720, 640, 64, (640, 384)),
        (1280, 720, 960, 64, (960, 576)),
        (100, 3, 640, 32, (640, 32)),
    ],
)
def test_the_input_keeps_the_frames_shape(
    width: int, height: int, image_size: int, stride: int, wanted: tuple[int, int]
) -> None:
    plan = plan_letterbox(width, height, image_size=image_size, stride=stride)
    assert (plan.width, plan.height) == wanted
    frame = np.zeros((height, width, 3), np.uint8)
    assert letterbox(frame, plan).shape == (plan.height, plan.width, 3)


def test_there_and_back_is_the_identity() -> None:
    plan = plan_letterbox(1280, 720, image_size=640, stride=32)
    points = np.random.default_rng(0).uniform(0, 700, (50, 2))
    np.testing.assert_allclose(plan.to_frame(plan.to_network(points)), points, atol=1e-9)


def test_the_first_pixels_centre_is_a_half_behind_the_border() -> None:
    plan = plan_letterbox(640, 360, image_size=640, stride=32)
    np.testing.assert_allclose(plan.to_network(np.zeros((1, 2))), [[0.5, 12.5]])


@pytest.mark.parametrize("size", [(640, 360), (1280, 720), (320, 180), (853, 480)])
def test_a_blob_lands_where_its_centre_is_mapped_to(size: tuple[int, int]) -> None:
    """The picture and the formula agree to a fraction of a pixel: no half pixel is lost."""
    width, height = size
    plan = plan_letterbox(width, height, image_size=640, stride=32)
    centre = np.array([0.61 * width, 0.37 * height])
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    spread = 0.02 * width
    glow = np.exp(-((u - centre[0]) ** 2 + (v - centre[1]) ** 2) / (2 * spread**2))
    frame = np.repeat((glow * 250)[..., None], 3, axis=2).round().astype(np.uint8)

    picture = letterbox(frame, plan)[plan.top : plan.top + plan.inner_height, :, 0].astype(float)
    y, x = np.mgrid[: picture.shape[0], : picture.shape[1]]
    # Pixel (0, 0) has its centre at 0.5 in network coordinates.
    seen = [(x * picture).sum() / picture.sum() + 0.5, (y * picture).sum() / picture.sum() + 0.5]
    seen[1] += plan.top
    np.testing.assert_allclose(seen, plan.to_network(centre[None])[0], atol=0.05)
