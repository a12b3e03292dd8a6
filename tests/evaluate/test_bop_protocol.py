"""BOP's errors and recalls against the formulas written out again, point by point and pixel by pixel."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Camera, FramePrediction, FrameTruth, Mesh, Part, Run
from asdfviz.errors import SequenceError
from asdfviz.evaluate.bop import View
from asdfviz.evaluate.bop_errors import bop_model, mspd, mssd, vsd
from asdfviz.evaluate.evaluate import evaluate_run
from asdfviz.geometry.transforms import rotation_about, transform_from

MakeTruth = Callable[..., FrameTruth]
MakePrediction = Callable[..., FramePrediction]
MakeRun = Callable[..., Run]

K = np.array([[300.0, 0, 159.5], [0, 310.0, 119.5], [0, 0, 1]])


def random_pose(rng: np.random.Generator, *, near: np.ndarray | None = None) -> np.ndarray:
    if near is None:
        R = rotation_about(rng.normal(size=3), rng.uniform(0, np.pi))
        return transform_from(R, np.array([*rng.uniform(-0.05, 0.05, 2), rng.uniform(0.4, 0.7)]))
    R = rotation_about(rng.normal(size=3), rng.uniform(0, 0.4))
    return transform_from(R @ near[:3, :3], near[:3, 3] + rng.normal(scale=0.01, size=3))


def symmetric_poses(part: Part, T: np.ndarray) -> list[np.ndarray]:
    """Every pose that looks like T: BOP's 315 steps about an axis through the origin, or the list."""
    poses = [T, *(T @ S for S in part.symmetries.discrete)]
    for axis in part.symmetries.continuous:
        assert not axis.offset.any()
        steps = [rotation_about(axis.direction, 2 * math.pi * i / 315) for i in range(315)]
        poses = [T @ transform_from(R, np.zeros(3)) for R in steps]
    return poses


def moved(T: np.ndarray, x: np.ndarray) -> np.ndarray:
    return T[:3, :3] @ x + T[:3, 3]


def in_picture(p: np.ndarray) -> np.ndarray:
    return np.array([K[0, 0] * p[0] / p[2] + K[0, 2], K[1, 1] * p[1] / p[2] + K[1, 2]])


@pytest.mark.parametrize("name", ["plate", "rod", "block"])
@pytest.mark.parametrize("seed", range(3))
def test_mssd_and_mspd(name: str, seed: int, assembly: Assembly) -> None:
    part = assembly.parts[name]
    rng = np.random.default_rng(seed)
    T_camera_truth = random_pose(rng)
    T_camera_estimate = random_pose(rng, near=T_camera_truth if seed else None)
    in_space, in_pixels = [], []
    points = part.mesh.vertices[:: 4 if name == "rod" else 1]
    part = Part(
        **{**{f: getattr(part, f) for f in part.__slots__}, "mesh": Mesh(points, part.mesh.faces)}
    )
    for T in symmetric_poses(part, T_camera_truth):
        pairs = [(moved(T_camera_estimate, x), moved(T, x)) for x in points]
        in_space.append(max(np.linalg.norm(a - b) for a, b in pairs))
        in_pixels.append(max(np.linalg.norm(in_picture(a) - in_picture(b)) for a, b in pairs))
    model = bop_model(part)
    assert mssd(T_camera_estimate, T_camera_truth, model) == pytest.approx(min(in_space), abs=1e-9)
    assert mspd(T_camera_estimate, T_camera_truth, model, K=K) == pytest.approx(
        min(in_pixels), abs=1e-6
    )


def test_few_far_points_never_hide_the_worst_one(assembly: Assembly) -> None:
    """More vertices than bounding points: the exact search must still ask all of them."""
    rng = np.random.default_rng(5)
    points = rng.normal(size=(400, 3)) * 0.02
    half = assembly.parts["block"]
    fields = {f: getattr(half, f) for f in half.__slots__}
    part = Part(**{**fields, "mesh": Mesh(points, half.mesh.faces)})
    for _ in range(10):
        T_camera_truth = random_pose(rng)
        T_camera_estimate = random_pose(rng, near=T_camera_truth)
        expected = min(
            max(np.linalg.norm(moved(T_camera_estimate, x) - moved(T, x)) for x in points)
            for T in symmetric_poses(part, T_camera_truth)
        )
        found = mssd(T_camera_estimate, T_camera_truth, bop_model(part))
        assert found == pytest.approx(expected, abs=1e-12)


def test_behind_the_camera_is_infinitely_far(assembly: Assembly) -> None:
    front = transform_from(np.eye(3), np.array([0.0, 0, 0.5]))
    behind = transform_from(np.eye(3), np.array([0.0, 0, -0.5]))
    assert mspd(behind, front, bop_model(assembly.parts["plate"]), K=K) == np.inf


def vsd_by_pixel(
    estimate: np.ndarray, truth: np.ndarray, seen: np.ndarray, diameter: float, tau: float
) -> float:
    """The definition: a cost for every pixel in the union of what both show."""
    union = cost = 0
    for v in range(truth.shape[0]):
        for u in range(truth.shape[1]):
            ray = math.sqrt(((u - 12.2) / 30) ** 2 + ((v - 9.7) / 32) ** 2 + 1)
            e, t, s = (float(image[v, u]) * ray for image in (estimate, truth, seen))
            truth_shows = t > 0 and (s == 0 or t - s <= 0.015)
            estimate_shows = e > 0 and (s == 0 or e - s <= 0.015 or truth_shows)
            if truth_shows or estimate_shows:
                union += 1
                fits = truth_shows and estimate_shows and abs(t - e) / diameter < tau
                cost += not fits
    return cost / union if union else 1.0


@pytest.mark.parametrize("seed", range(6))
def test_vsd(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = (20, 25)
    small = np.array([[30.0, 0, 12.2], [0, 32.0, 9.7], [0, 0, 1]])
    images: list[np.ndarray] = []
    for share in (0.4, 0.5, 0.8):
        depth = rng.uniform(0.45, 0.55, shape) * (rng.random(shape) < share)
        images.append(depth.astype(np.float32))
    estimate, truth, seen = images
    if seed == 5:
        truth[:], estimate[:] = 0, 0
    taus = np.array([0.05, 0.2, 0.5])
    found = vsd(estimate, truth, seen, small, diameter=0.15, taus=taus)
    expected = [vsd_by_pixel(estimate, truth, seen, 0.15, tau) for tau in taus]
    np.testing.assert_allclose(found, expected, atol=1e-9)
    if seed < 5:
        assert 0 < found[2] < found[0] < 1


def test_the_recalls_by_hand(
    assembly: Assembly,
    camera: Camera,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
) -> None:
    """The plate faces the camera at 0.5 m and is said 10 mm too deep, or not at all."""
    at = transform_from(np.eye(3), np.array([0.0, 0, 0.5]))
    deeper = transform_from(np.eye(3), np.array([0.0, 0, 0.51]))
    truth = {i: make_truth(i, {"plate": at}) for i in range(4)}
    truth[3] = make_truth(3, {"plate": at}, visible=0.05)  # too little to be asked for
    run = make_run([make_prediction(i, {"plate": T}) for i, T in enumerate([deeper, at])])
    report = evaluate_run(run, assembly=assembly, truth=truth, camera=camera, protocol="bop")
    plate = report["parts"]["plate"]
    diameter = assembly.parts["plate"].diameter
    # Frame 0 of three; frame 1 is perfect, frame 2 has no pose.
    mssd_recall = np.mean(0.01 / diameter < np.arange(0.05, 0.51, 0.05))
    assert plate["ar_mssd"] == pytest.approx(100 * (mssd_recall + 1) / 3)
    corner = 300 * np.hypot(0.04, 0.02) * (1 / 0.49 - 1 / 0.50)  # of the nearer face
    mspd_recall = np.mean(2 * corner < np.arange(5, 51, 5))  # 320 pixels wide: doubled
    assert plate["ar_mspd"] == pytest.approx(100 * (mspd_recall + 1) / 3)
    # 10 mm is 0.109 d: at taus 0.05 and 0.10 all is wrong, above only the rim is.
    rim = 1 - (0.49 / 0.50) ** 2
    taus = np.arange(0.05, 0.51, 0.05)
    vsd_recall = (taus > 0.109).mean() * (rim < taus).mean()
    assert plate["ar_vsd"] == pytest.approx(100 * (vsd_recall + 1) / 3)
    mean = (plate["ar_mssd"] + plate["ar_mspd"] + plate["ar_vsd"]) / 3
    assert report["mean"]["ar_bop"] == plate["ar_bop"] == pytest.approx(mean)
    assert report["parts"]["rod"]["ar_bop"] is None
    assert report["vsd_depth"] == {"measured_frames": 0, "rendered_frames": 2}
    assert report["mean"]["add_s_10cm"] == pytest.approx(200 / 3)


def test_measured_depth_hides_what_it_hides(
    assembly: Assembly,
    camera: Camera,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
) -> None:
    """A wall right in front of the plate: nothing of either pose shows, so VSD fails it."""
    at = transform_from(np.eye(3), np.array([0.0, 0, 0.5]))
    truth = {0: make_truth(0, {"plate": at})}
    run = make_run([make_prediction(0, {"plate": at})])
    wall = np.full((camera.height, camera.width), 0.3, dtype=np.float32)
    for depth, expected in ((wall, 0), (np.zeros_like(wall), 100)):
        report = evaluate_run(
            run,
            assembly=assembly,
            truth=truth,
            protocol="bop",
            views=lambda index, depth=depth: View(camera, depth),
        )
        assert report["mean"]["ar_vsd"] == expected
        assert report["mean"]["ar_mssd"] == 100
        assert report["vsd_depth"] == {"measured_frames": 1, "rendered_frames": 0}
    with pytest.raises(SequenceError, match="no camera"):
        evaluate_run(run, assembly=assembly, truth=truth, protocol="bop")
