from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.transforms import rotation_about
from asdfviz.pose.labels import LabelledObject
from asdfviz.train.augment import Sample, marks_in, move_points, roll, similarity
from asdfviz.train.dataset import LabelledImage
from asdfviz.train.packing import AugmentConfig, Packer
from asdfviz.train.patches import (
    ColorChange,
    ColorConfig,
    Patch,
    change_colors,
    cut_input,
    cut_patch,
    draw_colors,
)

DOT = np.array([41.0, 22.0])
AS_IT_IS = ColorChange(1.0, (1.0, 1.0, 1.0), 1.0, 0.0, 0.0, 0)
K_TILTED = np.array([[80.0, 0, 47], [0, 90, 31], [0, 0, 1]])


def dotted(*, part: str | None = "body") -> LabelledImage:
    """A dark picture with one bright dot, which is every keypoint of one object."""
    v, u = np.mgrid[:64, :96]
    glow = np.exp(-((u - DOT[0]) ** 2 + (v - DOT[1]) ** 2) / (2 * 1.5**2))
    rgb = np.repeat((glow * 255).round().astype(np.uint8)[..., None], 3, axis=2)
    keypoints = np.concatenate([np.tile(DOT, (17, 1)), np.full((17, 1), 2.0)], 1)
    box = np.array([[-9, -6], [9, -6], [9, 6], [-9, 6]]) + DOT
    T_camera_part = np.eye(4)
    T_camera_part[:3, 3] = [0.05, -0.03, 0.5]
    item = LabelledObject(
        label=1,
        outline=box.astype(np.float32),
        keypoints=keypoints.astype(np.float32) * (part is not None),
        visible=1.0,
        part=part,
        T_camera_part=T_camera_part if part else None,
    )
    return LabelledImage(name="dot", assembly="toy", rgb=rgb, K=K_TILTED, objects=(item,))


def bright_spot(sample: Sample, box: np.ndarray | None = None) -> np.ndarray:
    """Centre of brightness in network coordinates (first pixel's centre at 0.5)."""
    weight = sample.rgb[..., 0].astype(float)
    weight[weight < 40] = 0
    y, x = np.mgrid[: weight.shape[0], : weight.shape[1]] + 0.5
    if box is not None:
        weight[(x < box[0]) | (x > box[2]) | (y < box[1]) | (y > box[3])] = 0
    return np.array([(x * weight).sum(), (y * weight).sum()]) / weight.sum()


@pytest.mark.parametrize("angle_deg", [0, 20, 90, -137, 180])
@pytest.mark.parametrize("zoom", [0.8, 1.0, 2.3])
def test_the_label_stays_on_the_dot(angle_deg: float, zoom: float) -> None:
    image = dotted()
    angle = np.radians(angle_deg)
    H_roll = roll(image.K, angle)
    middle = move_points(H_roll, DOT[None].astype(np.float32))[0].astype(float)
    H = similarity(middle, np.array([50.3, 40.8]), zoom) @ H_roll
    marks = marks_in(image, H, width=112, height=96, angle=angle)
    patch = Patch(0, H, 0, 0, 112, 96, (0, 0, 0), AS_IT_IS)
    np.testing.assert_allclose(marks.keypoints[0, :, :2], np.tile([50.8, 41.3], (17, 1)), atol=1e-3)
    spot = bright_spot(Sample(cut_patch(image.rgb, patch), marks))
    np.testing.assert_allclose(spot, marks.keypoints[0, 0, :2], atol=0.1)


def test_a_roll_is_a_turned_camera() -> None:
    """Rolling the picture equals projecting points turned about the optical axis."""
    points = np.random.default_rng(0).uniform([-0.2, -0.1, 0.4], [0.2, 0.1, 0.9], (20, 3))
    angle = 0.7
    turned = points @ rotation_about(np.array([0.0, 0.0, 1.0]), angle).T
    before, after = points @ K_TILTED.T, turned @ K_TILTED.T
    pixels = (before[:, :2] / before[:, 2:]).astype(np.float32)
    moved = move_points(roll(K_TILTED, angle), pixels)
    np.testing.assert_allclose(moved, after[:, :2] / after[:, 2:], atol=1e-3)


def test_boxes_follow_the_outline_and_are_clipped() -> None:
    image = dotted()
    whole = marks_in(image, np.eye(3), width=96, height=64, angle=0.0)
    np.testing.assert_allclose(whole.boxes, [[32.5, 16.5, 50.5, 28.5]])
    shifted = similarity(np.array([35.0, 22.0]), np.array([0.0, 22.0]), 1.0)
    cut = marks_in(image, shifted, width=96, height=64, angle=0.0)
    np.testing.assert_allclose(cut.boxes, [[0, 16.5, 15.5, 28.5]])
    far = similarity(np.array([47.0, 22.0]), np.array([0.0, 22.0]), 1.0)
    assert len(marks_in(image, far, width=96, height=64, angle=0.0).labels) == 0
    state = marks_in(dotted(part=None), shifted, width=96, height=64, angle=0.0)
    assert len(state.labels) == 1
    half = similarity(np.array([39.0, 22.0]), np.array([0.0, 22.0]), 1.0)
    assert len(marks_in(dotted(), half, width=96, height=64, angle=0.0).labels) == 1
    gone = marks_in(dotted(part=None), half, width=96, height=64, angle=0.0)
    assert len(gone.labels) == 0


def test_keypoints_outside_count_as_hidden() -> None:
    H = similarity(DOT, np.array([-3.0, 20.0]), 1.0)
    sample = marks_in(dotted(), H, width=96, height=64, angle=0.0, smallest_inside=0.05)
    assert (sample.keypoints[0, :, 2] == 1).all()


def test_the_ray_rotation_turns_with_the_roll() -> None:
    image = dotted()
    straight = marks_in(image, np.eye(3), width=96, height=64, angle=0.0)
    rolled = marks_in(image, roll(image.K, 0.3), width=96, height=64, angle=0.3)
    R = rotation_about(np.array([0.0, 0.0, 1.0]), 0.3)
    np.testing.assert_allclose(rolled.rotations[0], R @ straight.rotations[0], atol=1e-6)
    assert np.linalg.det(straight.rotations[0]) == pytest.approx(1.0, abs=1e-5)


def test_colours_change_but_stay_a_picture() -> None:
    rng = np.random.default_rng(3)
    rgb = rng.integers(0, 255, (40, 60, 3), dtype=np.uint8)
    versions = [change_colors(rgb, draw_colors(rng, ColorConfig())) for _ in range(8)]
    assert all(v.shape == rgb.shape and v.dtype == np.uint8 for v in versions)
    assert len({v.tobytes() for v in versions}) == 8
    calm = ColorConfig(
        **dict.fromkeys(("gain", "gamma", "balance", "saturation", "blur", "noise"), 0.0)
    )
    assert int(np.abs(change_colors(rgb, draw_colors(rng, calm)).astype(int) - rgb).max()) <= 1


QUIET = AugmentConfig(
    center=0.1,
    colors=ColorConfig(
        **dict.fromkeys(("gain", "gamma", "balance", "saturation", "blur", "noise"), 0.0)
    ),
)


@pytest.mark.parametrize("seed", range(4))
def test_tiles_keep_every_label_on_its_dot(seed: int) -> None:
    image = dotted()
    dark = LabelledImage(image.name, "toy", image.rgb, image.K, image.objects)
    packer = Packer([dark], side=96, config=QUIET)
    plan = packer.packed(np.random.default_rng(seed), width=320, height=192, spread=1.0)
    sample, marks = cut_input(packer.images, plan), plan.marks
    assert len(marks.labels) >= 4
    for box, keypoints in zip(marks.boxes, marks.keypoints, strict=True):
        point = keypoints[0, :2]
        near = np.array([*(point - 5), *(point + 5)])
        # Grey fill around a tile may be brighter than the dot: look only where the dot must be.
        inside = (near[:2] > 0).all() and near[2] < 320 and near[3] < 192
        if inside and sample.rgb[int(point[1]), int(point[0]), 0] > 200:
            np.testing.assert_allclose(bright_spot(sample, near), point, atol=0.6)
        assert (box[2:] > box[:2]).all()


def test_packing_fills_the_input_with_objects() -> None:
    packer = Packer([dotted()], side=96, config=AugmentConfig())
    counts = [
        len(packer.packed(np.random.default_rng(s), width=640, height=384, spread=1.0).marks.labels)
        for s in range(6)
    ]
    assert min(counts) >= 6
    assert max(counts) >= 20


def test_the_same_seed_draws_the_same_input() -> None:
    packer = Packer([dotted()], side=96, config=AugmentConfig())
    for draw in (packer.packed, packer.frame):
        a, b = (draw(np.random.default_rng(5), width=320, height=192, spread=0.5) for _ in range(2))
        first, second = (cut_input(packer.images, plan).rgb for plan in (a, b))
        np.testing.assert_array_equal(first, second)
        np.testing.assert_array_equal(a.marks.keypoints, b.marks.keypoints)


def test_states_get_tiles_of_their_own() -> None:
    part, state = dotted(), dotted(part=None)
    both = [part, LabelledImage("state", "toy", state.rgb, state.K, state.objects)]
    for share, seen in ((0.0, False), (1.0, True)):
        packer = Packer(both, side=96, config=AugmentConfig(states=share))
        marks = packer.packed(np.random.default_rng(0), width=320, height=192, spread=1.0).marks
        assert len(marks.labels) > 0
        assert bool((marks.keypoints[:, 0, 2] == 0).all()) is seen
