from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import Camera
from asdfviz.errors import InputError
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.track import color_histograms, region_kernels
from asdfviz.track.color_histograms import ColorHistograms
from asdfviz.track.optimizer import move
from asdfviz.track.region_modality import (
    RegionConfig,
    RegionModality,
    least_variance,
    step_function,
)
from asdfviz.track.viewpoint_model import ViewpointModel

T = transform_from(rotation_about(np.array([0.3, -0.8, 0.2]), 0.7), np.array([0.02, -0.03, 0.5]))
LENS = np.array([300.0, 310.0, 159.5, 119.5])


def a_line(mean: float = 0.7, variance: float = 1.3) -> np.ndarray:
    """A line whose middle is near the projection of its point."""
    point = np.array([0.03, -0.02, 0.01])
    x = T[:3, :3] @ point + T[:3, 3]
    pixel = LENS[:2] * x[:2] / x[2] + LENS[2:]
    n = np.array([0.6, -0.8])
    return np.array([*point, *pixel, *n, 0.2, 0.8 / 2, mean, variance])


def moved(theta: np.ndarray) -> np.ndarray:
    T_new = T.copy()
    move(T_new, theta)
    return T_new


@pytest.mark.parametrize(
    ("amplitude", "slope", "expected"), [(0.36, 0.0, 0.607), (0.43, 0.5, 0.5), (0.43, 0.1, 0.299)]
)
def test_least_variance_is_the_papers(amplitude: float, slope: float, expected: float) -> None:
    config = RegionConfig(amplitude=amplitude, slope=slope)
    assert least_variance(config) == pytest.approx(expected, abs=1e-3)


def test_step_function_falls_from_foreground_to_background() -> None:
    smooth = step_function(RegionConfig(amplitude=0.43, slope=0.5))
    assert (np.diff(smooth) < 0).all()
    np.testing.assert_allclose(smooth + smooth[::-1], 1.0)
    sharp = step_function(RegionConfig(amplitude=0.36, slope=0.0))
    np.testing.assert_allclose(sharp, [0.86] * 4 + [0.14] * 4)


def test_distribution_equals_the_product_written_out() -> None:
    rng = np.random.default_rng(3)
    foreground, step = rng.random(19), step_function(RegionConfig())
    p = np.zeros(12)
    mean, variance = region_kernels.distribution(foreground, step, p)
    windows = np.lib.stride_tricks.sliding_window_view(foreground, 8)
    expected = np.prod(windows * step + (1 - windows) * (1 - step), axis=1)
    expected /= expected.sum()
    np.testing.assert_allclose(p, expected, rtol=1e-12)
    d = np.arange(12) - 5.5
    assert mean == pytest.approx(expected @ d)
    assert variance == pytest.approx(expected @ (d - expected @ d) ** 2)


@pytest.mark.parametrize("boundary", range(6, 14))
def test_distribution_finds_where_the_colour_changes(boundary: int) -> None:
    foreground = np.where(np.arange(19) < boundary, 0.97, 0.03)
    p = np.zeros(12)
    mean, _ = region_kernels.distribution(foreground, step_function(RegionConfig()), p)
    assert mean == pytest.approx(boundary - 9.5, abs=0.05)


@pytest.mark.parametrize("normal", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.6, -0.8), (-0.8, 0.6)])
def test_segments_run_from_inside_to_outside(normal: tuple[float, float]) -> None:
    """Left of the normal's tail every pixel is foreground; the edge is where delta_r says."""
    n = np.array(normal)
    v, u = np.mgrid[:120, :160]
    centre = np.array([80.3, 60.7])
    inside = (u - centre[0]) * n[0] + (v - centre[1]) * n[1] < 0
    image = np.where(inside[..., None], 255, 0).astype(np.uint8).repeat(3, axis=2)
    table = np.zeros(4096, np.float32)
    table[-1] = 1.0
    out = np.zeros(64)
    delta_r = region_kernels.segments(image, table, 4, np.array([*centre, 0.5, *n]), 2, 19, out)
    # Distance along the normal of each segment's middle from the edge.
    pace = 2 / np.abs(n).max()
    middles = delta_r + (np.arange(19) - 9) * pace
    clear = np.abs(middles) > 1.5 * pace
    np.testing.assert_array_equal(out[:19][clear], (middles < 0)[clear])


def test_segments_off_the_image_are_refused() -> None:
    image, table = np.zeros((40, 60, 3), np.uint8), np.full(4096, 0.5, np.float32)
    for at in ([3.0, 20.0, 0.5, 1.0, 0.0], [30.0, 38.0, 0.5, 0.0, 1.0], [30, 2, 0.5, 0.8, 0.6]):
        out = np.zeros(64)
        assert np.isnan(region_kernels.segments(image, table, 4, np.array(at), 2, 19, out))


def test_line_offset_derivative_is_that_of_finite_differences() -> None:
    line, derivative = a_line(), np.zeros(6)
    at_pose = region_kernels.line_offset(line, T, LENS, derivative)
    assert at_pose == pytest.approx(-0.2 * 0.4)
    unused = np.zeros(6)
    for i in range(6):
        step = np.zeros(6)
        step[i] = 1e-6
        up = region_kernels.line_offset(line, moved(step), LENS, unused)
        down = region_kernels.line_offset(line, moved(-step), LENS, unused)
        assert (up - down) / 2e-6 == pytest.approx(derivative[i], rel=1e-5, abs=1e-6)


def test_global_gradient_is_that_of_the_weighted_normal_log_likelihood() -> None:
    lines = np.stack([a_line(0.7, 1.3), a_line(-1.1, 0.6)])
    spread = np.array([0.5, 15.0])

    def log_likelihood(theta: np.ndarray) -> float:
        total = 0.0
        for line in lines:
            delta = region_kernels.line_offset(line, moved(theta), LENS, np.zeros(6))
            weight = 0.5 / (line[8] * 15.0) ** 2
            total -= weight * (delta - line[9]) ** 2 / (2 * line[10])
        return total

    gradient, hessian = np.zeros(6), np.zeros((6, 6))
    region_kernels.add_lines(lines, np.ones((2, 12)), 2, T, LENS, spread, 0.0, gradient, hessian)
    for i in range(6):
        step = np.zeros(6)
        step[i] = 1e-5
        numeric = (log_likelihood(step) - log_likelihood(-step)) / 2e-5
        assert gradient[i] == pytest.approx(numeric, rel=1e-4, abs=1e-6)
    full = hessian + np.tril(hessian, -1).T
    assert np.linalg.eigvalsh(full).min() > -1e-6
    assert np.linalg.matrix_rank(full, tol=1e-6) == 1


def test_local_slope_climbs_the_neighbouring_values() -> None:
    line, p = a_line(variance=2.0), np.linspace(1.0, 12.0, 12)
    assert region_kernels.slope_of(line, p, 0.1, 1.3) == pytest.approx(np.log(7 / 6) * 1.3 / 2)
    assert np.isnan(region_kernels.slope_of(line, p, 6.0, 1.3))
    assert np.isnan(region_kernels.slope_of(line, p, -6.0, 1.3))


def test_histograms_blend_and_keep_what_they_cannot_see() -> None:
    histograms = ColorHistograms(16)
    histograms.counts[5, 0], histograms.counts[9, 0], histograms.counts[9, 1] = 3.0, 1.0, 4.0
    histograms.learn(1.0)
    assert histograms.table[5] == 1.0
    assert histograms.table[9] == pytest.approx(0.25 / 1.25)
    assert histograms.table[0] == 0.5
    assert (histograms.counts == 0).all()
    histograms.counts[5, 1] = 2.0
    histograms.learn(0.2)
    # Foreground saw nothing and stays; background is 0.8 old and 0.2 new.
    assert histograms.table[5] == pytest.approx(0.75 / 0.95)
    assert histograms.table[9] == pytest.approx(0.25 / 1.05)


def test_colours_are_counted_on_their_own_side(box_model: ViewpointModel, camera: Camera) -> None:
    T_camera_centre = transform_from(
        rotation_about(np.array([1.0, 0, 0]), 0.6), np.array([0, 0, 0.45])
    )
    lens = np.array([300.0, 300.0, 159.5, 119.5])
    modality = RegionModality(box_model, lens, RegionConfig())
    rgb = np.zeros((240, 320, 3), np.uint8)
    modality.start(rgb, T_camera_centre)
    # One colour on both sides says nothing of either.
    assert modality.histograms.table[0] == pytest.approx(0.5)
    points = box_model.contours[0]
    counts = np.zeros((4096, 2), np.float32)
    color_histograms.count_colors(
        rgb, 4, points, 0, T_camera_centre, lens, np.array([0.5, 20.0]), np.zeros((0, 0), np.float32),
        np.zeros(200, np.float32), np.zeros(2), np.zeros((0, 0), np.int32), np.zeros(3), 0, counts,
    )  # fmt: skip
    assert counts.sum() == 0


@pytest.mark.parametrize(
    "wrong", [{"histogram_bins": 20}, {"amplitude": 0.5}, {"function_length": 60}]
)
def test_impossible_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(wrong)).split("_")[0] + "|line"):
        RegionConfig(**wrong)  # type: ignore[arg-type]
