from __future__ import annotations

import numpy as np

from asdfviz.synth.depth_sensor import DepthSensor, field_of_view, measure_depth
from asdfviz.synth.kinect import KINECT_LENS, camera_for

HEIGHT, WIDTH = 180, 320


def flat(depth: float = 0.6) -> np.ndarray:
    return np.full((HEIGHT, WIDTH), depth, np.float32)


def bright() -> np.ndarray:
    return np.full((HEIGHT, WIDTH), 0.4, np.float32)


def measured(
    depth: np.ndarray, albedo: np.ndarray, sensor: DepthSensor | None = None, **setting: object
) -> np.ndarray:
    sensor = sensor or DepthSensor(**setting)  # pyright: ignore[reportArgumentType]
    return measure_depth(depth, albedo, sensor=sensor, rng=np.random.default_rng(0))


def test_range_noise_has_the_asked_size_and_grows_with_distance() -> None:
    near = measured(flat(0.6), bright(), noise=0.001, field_of_view=False)
    far = measured(flat(1.2), bright(), noise=0.001, field_of_view=False)
    assert 0.0004 < near.std() < 0.002
    assert 3 < far.std() / near.std() < 5
    assert abs(near.mean() - 0.6) < 1e-4


def test_dark_surfaces_lose_returns_and_bright_ones_do_not() -> None:
    albedo = bright()
    albedo[:, :100] = 0.005
    depth = measured(flat(), albedo, dark_loss=0.5, field_of_view=False)
    assert 0.2 < (depth[:, :100] == 0).mean() < 0.8
    assert (depth[:, 110:] > 0).all()


def test_edges_are_smeared_and_shadowed_on_one_side() -> None:
    depth = flat(0.6)
    depth[60:120, 120:200] = 0.5
    seen = measured(depth, bright(), noise=0.0, field_of_view=False, smear_px=8.0)
    row = seen[90]
    between = (row > 0.505) & (row < 0.595)
    assert 1 <= between[112:128].sum() <= 12
    assert (row[196:210] == 0).any()
    assert (row[112:120] > 0).all()
    assert abs(row[160] - 0.5) < 1e-3


def test_field_of_view_leaves_the_share_that_the_real_camera_leaves() -> None:
    outside = (~field_of_view(720, 1280)).mean()
    assert 0.38 < outside < 0.45
    seen = measured(flat(), bright())
    assert seen[0, 0] == 0
    assert seen[HEIGHT // 2, WIDTH // 2] > 0


def test_shift_moves_depth_against_colour() -> None:
    depth = flat(0.6)
    depth[:, 160:] = 0.5
    still = measured(depth, bright(), noise=0.0, field_of_view=False)
    moved = measured(depth, bright(), noise=0.0, field_of_view=False, shift_px=(28.0, 0.0))
    edge = [
        int(np.argmax(d[90] < 0.55))
        for d in (np.where(still > 0, still, 9), np.where(moved > 0, moved, 9))
    ]
    assert edge[1] - edge[0] == 7


def test_nothing_stays_nothing() -> None:
    depth = flat()
    depth[:40] = 0
    assert (measured(depth, bright(), field_of_view=False)[:30] == 0).all()


def kinect_view() -> tuple[np.ndarray, np.ndarray]:
    """A table at 0.53 m with a blue block, 50 mm high, and a black one, as in the real frames."""
    depth = np.full((720, 1280), 0.53, np.float32)
    albedo = np.full((720, 1280), 0.4, np.float32)
    depth[300:460, 350:470] = 0.48
    albedo[300:460, 350:470] = 0.1
    depth[200:330, 800:900] = 0.5
    albedo[200:330, 800:900] = 0.008
    return depth, albedo


def test_depth_looks_like_the_real_frames() -> None:
    """Real: 43 % missing in all, 2.4 to 2.6 % within the view, 1.8 mm noise on the table."""
    depth, albedo = kinect_view()
    seen = measure_depth(depth, albedo, sensor=DepthSensor(), rng=np.random.default_rng(3))
    view = field_of_view(720, 1280)
    assert 0.40 < (seen == 0).mean() < 0.46
    assert 0.003 < (seen[view] == 0).mean() < 0.05
    table = seen[480:640, 400:880]
    assert 0.0012 < table.std() < 0.0028
    # Neighbours agree: 0.97 at one pixel, 0.87 at five.
    off = table - table.mean()
    agreement = [(off[:, k:] * off[:, :-k]).mean() / off.var() for k in (1, 5)]
    assert agreement[0] > 0.9
    assert 0.6 < agreement[1] < 0.98
    assert 0.1 < (seen[200:330, 800:900] == 0).mean() < 0.7


def test_edges_are_ramps_longer_away_from_the_illuminator() -> None:
    """Real: 4 px on the left of 50 mm and 13 on their right, from 10 to 90 % of the step."""
    depth, _ = kinect_view()
    light = np.full_like(depth, 0.4)
    sensor = DepthSensor(noise=0.0, edge_jump=1.0)
    row = measure_depth(depth, light, sensor=sensor, rng=np.random.default_rng(0))[380]
    share = (row - 0.48) / 0.05
    ramps = [((share > 0.1) & (share < 0.9))[a:b].sum() for a, b in ((330, 390), (440, 510))]
    assert 3 <= ramps[0] <= 7
    assert 10 <= ramps[1] <= 17


def test_trails_are_as_long_as_what_the_illuminator_does_not_reach() -> None:
    """What a thing at n hides from a light b to its left is f b (1/n - 1/d) wide; nothing on the left."""
    depth = np.full((720, 1280), 0.7, np.float32)
    depth[300:400, 300:400] = 0.69  # a plate that lies on the table
    depth[300:400, 700:800] = 0.6
    sensor = DepthSensor(noise=0.0, smear_px=0.0, edge_jump=9.0, field_of_view=False, trail=2.0)
    row = measured(depth, np.full_like(depth, 0.4), sensor=sensor)[350]
    off = np.abs(row - depth[350]) > 1e-3
    reach = [2.0 * 0.032 * 607.25 * (1 / near - 1 / 0.7) for near in (0.69, 0.6)]
    assert reach[0] < 1
    assert off[400:430].sum() <= 2
    assert abs(off[800:840].sum() - reach[1]) <= 2
    assert off[280:300].sum() <= 2
    assert off[680:700].sum() <= 2


def test_behind_high_steps_the_far_end_of_the_trail_is_lost() -> None:
    """Real: behind 140 mm and more 12 pixels are left of the ramp, then 24 lost, then the table."""
    depth = np.full((720, 1280), 0.7, np.float32)
    depth[300:400, 300:400] = 0.66
    depth[300:400, 700:800] = 0.5
    sensor = DepthSensor(noise=0.0, field_of_view=False)
    row = measured(depth, np.full_like(depth, 0.4), sensor=sensor)[350]
    assert (row[280:780] > 0).all()
    (lost,) = np.nonzero(row == 0)
    hidden = 0.032 * 607.25 * (1 / 0.5 - 1 / 0.7)
    assert abs(len(lost) - hidden) <= 1
    assert abs(lost.max() - (799 + 3 * hidden)) <= 1
    assert np.all(np.diff(lost) == 1)


def test_the_lens_moves_depth_towards_the_middle_more_and_more() -> None:
    """A point 335 px from the centre is displaced by 2.3 % in the real frames."""
    depth = np.full((720, 1280), 0.6, np.float32)
    for x in (339, 489, 789, 939):
        depth[:, x : x + 2] = 0.5
    still, bent = (
        measure_depth(
            depth,
            np.full_like(depth, 0.4),
            sensor=DepthSensor(
                noise=0.0, smear_px=0.0, trail=0.0, edge_jump=1.0, field_of_view=False, lens=lens
            ),
            rng=np.random.default_rng(0),
        )[365]
        for lens in ((0.0, 0.0, 0.0), KINECT_LENS)
    )
    moved = [
        float(np.argmin(bent[x - 20 : x + 20])) - float(np.argmin(still[x - 20 : x + 20]))
        for x in (340, 490, 790, 940)
    ]
    assert 4 <= moved[0] <= 9
    assert 0 <= moved[1] <= 2
    assert -2 <= moved[2] <= 0
    assert -9 <= moved[3] <= -4


def test_the_lens_is_the_camera_s_at_any_image_size() -> None:
    width, height = 480, 640
    K = camera_for(width, height).K
    at = np.stack(np.meshgrid(np.arange(20, width, 110), np.arange(20, height, 120)), -1)
    rays = (at - K[:2, 2]) / np.diagonal(K)[:2]
    r2 = (rays**2).sum(axis=-1, keepdims=True)
    stretch = 1 + r2 * (KINECT_LENS[0] + r2 * (KINECT_LENS[1] + r2 * KINECT_LENS[2]))
    seen = rays * stretch * np.diagonal(K)[:2] + K[:2, 2]
    sensor = DepthSensor(noise=0.0, trail=0.0, edge_jump=9.0, field_of_view=False, lens=KINECT_LENS)
    for axis in (0, 1):
        ramp = 0.5 + np.indices((height, width))[1 - axis].astype(np.float32) / 1000
        albedo = np.full_like(ramp, 0.4)
        bent = measure_depth(ramp, albedo, sensor=sensor, rng=np.random.default_rng(0))
        read = (bent[at[..., 1], at[..., 0]] - 0.5) * 1000
        inside = ((seen > 5) & (seen < np.array([width, height]) - 5)).all(axis=-1)
        assert inside.sum() > 12
        np.testing.assert_allclose(read[inside], seen[inside, axis], atol=1.5)
