"""Boxes of a part whose keypoints are off by what their scores say, or by what they do not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asdfviz.bench.keypoints import (
    KnownBox,
    keypoint_table,
    known_boxes,
    measure_keypoints,
)
from asdfviz.cli.bench import BenchKeypoints
from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly, Camera, Detection, FramePrediction, FrameTruth
from asdfviz.errors import InputError
from asdfviz.geometry.boxes import box_around
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply, rotation_about, transform_from

CAMERA = Camera(np.array([[600.0, 0, 320], [0, 600, 180], [0, 0, 1]]), 640, 360)
NOBODY = FramePrediction(0, {}, None)


def pose(seed: int) -> Transform:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    R = rotation_about(axis / np.linalg.norm(axis), float(rng.uniform(0.2, 1.2)))
    return transform_from(R, np.array([*rng.uniform(-0.05, 0.05, 2), 0.5]))


@pytest.fixture(scope="module")
def clamp() -> Assembly:
    return load_assembly("corner_clamp")


def seen(assembly: Assembly, seed: int, *, honest: bool) -> tuple[Detection, FrameTruth]:
    """The base as a network sees it: some keypoints off by far, with low scores or with high ones."""
    part, T, rng = assembly.parts[assembly.base], pose(seed), np.random.default_rng(seed)
    true = project(apply(T, part.keypoints), CAMERA.K)
    box = box_around(project(apply(T, part.mesh.vertices), CAMERA.K))
    is_off = rng.random(len(true)) < 0.35
    reach = np.where(is_off, 0.12, 0.005) * np.hypot(*(box[2:] - box[:2]))
    off = true + rng.normal(size=true.shape) * reach[:, None]
    scores = np.where(is_off == honest, 0.1, 0.9) + rng.uniform(-0.05, 0.05, len(true))
    detection = Detection(part.detector_class, box, off, scores, 0.9)
    return detection, FrameTruth(seed, {assembly.base: T}, None)


def boxes(assembly: Assembly, *, honest: bool) -> list[KnownBox]:
    made = [seen(assembly, seed, honest=honest) for seed in range(12)]
    said = [replace(NOBODY, frame_index=k, detections=(d,)) for k, (d, _) in enumerate(made)]
    truth = {t.frame_index: t for _, t in made}
    return list(known_boxes(assembly, said, truth, lambda _: CAMERA))


def test_scores_that_say_how_far_off_keypoints_are(clamp: Assembly) -> None:
    figures = measure_keypoints(boxes(clamp, honest=True))
    assert figures is not None
    assert figures.boxes == 12
    assert figures.rank_correlation < -0.5
    assert figures.bins[0].off_median > 10 * figures.bins[-1].off_median
    assert sum(b.count for b in figures.bins) == 12 * 17
    assert figures.turned_deg_median is not None
    assert figures.turned_deg_median_alike is not None
    assert figures.turned_deg_median < figures.turned_deg_median_alike
    assert "with scores" in keypoint_table(figures)


def test_scores_that_say_the_contrary(clamp: Assembly) -> None:
    figures = measure_keypoints(boxes(clamp, honest=False))
    assert figures is not None
    assert figures.rank_correlation > 0.5
    assert figures.turned_deg_median is not None
    assert figures.turned_deg_median_alike is not None
    assert figures.turned_deg_median > figures.turned_deg_median_alike


def test_only_boxes_on_a_part_of_their_class_count(clamp: Assembly) -> None:
    detection, truth = seen(clamp, 0, honest=True)
    aside = replace(detection, box_xyxy=detection.box_xyxy + 300.0)
    other = replace(detection, label=next(n for n in clamp.parts if n != clamp.base))
    few = Detection(
        detection.label,
        detection.box_xyxy,
        detection.keypoints_px[:5],
        detection.keypoint_scores[:5],
        0.9,
    )
    said = replace(NOBODY, detections=(aside, other, few))
    assert not list(known_boxes(clamp, [said], {0: truth}, lambda _: CAMERA))
    assert not list(
        known_boxes(clamp, [replace(said, frame_index=7)], {0: truth}, lambda _: CAMERA)
    )
    assert measure_keypoints([]) is None


def test_the_command_reads_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from asdfviz.data.run_files import save_run
    from asdfviz.data.sequences import open_sequence
    from asdfviz.methods.registry import find_method
    from asdfviz.run import run

    spec = find_method("yolov8pose")
    save_run(run(spec, open_sequence("sample"), first=2), tmp_path / "run")
    BenchKeypoints((tmp_path / "run",), json=True)()
    told = json.loads(capsys.readouterr().out)
    assert 2 <= told["boxes"] <= 8
    assert sum(b["count"] for b in told["bins"]) == 17 * told["boxes"]
    with pytest.raises(InputError, match="no box with keypoints lies on a part"):
        BenchKeypoints(())()
