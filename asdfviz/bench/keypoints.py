"""What keypoint scores are worth: whether surer keypoints are nearer, and what they do as weights in PnP.

Boxes are lined up with the true parts of their class that they overlap by half or more; of a symmetric
part the keypoints are those of the canonical pose, as training labels them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, Camera, Detection, FramePrediction, FrameTruth, Part
from asdfviz.geometry.boxes import box_around, iou_matrix
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Box, Scores, Transform
from asdfviz.geometry.symmetry import canonical, symmetric_angle
from asdfviz.geometry.transforms import apply
from asdfviz.pose.pnp import ROBUST_PNP, PnpSolution, solve_pnp

OVERLAP = 0.5
"""Intersection over union from which a box is that of a part."""
BINS = 5
"""Of scores from 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownBox:
    """A detection and the part that it is."""

    detection: Detection
    part: Part
    T_camera_part: Transform
    """The true pose."""
    camera: Camera


@dataclass(frozen=True, slots=True)
class ScoreBin:
    """Keypoints of about the same score."""

    score: float
    """Mean, 0 to 1."""
    count: int
    off_median: float
    """Distance to the true ones, share of the box's diagonal."""


@dataclass(frozen=True, slots=True)
class KeypointFigures:
    """Of all boxes together."""

    boxes: int
    bins: tuple[ScoreBin, ...]
    rank_correlation: float
    """Spearman's, of score and distance, -1 to 1: below 0 where surer keypoints are nearer."""
    solved: int
    """Boxes of which PnP makes a pose with and without scores,"""
    turned_deg_median: float | None
    """how far off its rotation is with them (symmetric), degrees,"""
    turned_deg_median_alike: float | None
    """and where all count alike."""


def known_boxes(
    assembly: Assembly,
    predictions: Sequence[FramePrediction],
    truth: Mapping[int, FrameTruth],
    camera_of: Callable[[int], Camera],
) -> Iterator[KnownBox]:
    """The boxes with keypoints that lie on a part of their class.

    Args:
        assembly: its parts.
        predictions: with detections, as a run keeps them.
        truth: by frame number.
        camera_of: the camera of a frame, by its number.
    """
    for said in predictions:
        if said.frame_index not in truth:
            continue
        camera, poses = camera_of(said.frame_index), truth[said.frame_index].T_camera_part
        true = {
            name: box_around(project(apply(T, assembly.parts[name].mesh.vertices), camera.K))
            for name, T in poses.items()
        }
        for detection in said.detections:
            name = _part_below(detection, assembly, true)
            if name is not None:
                yield KnownBox(detection, assembly.parts[name], poses[name], camera)


def _part_below(detection: Detection, assembly: Assembly, true: Mapping[str, Box]) -> str | None:
    """The part of a detection's class whose box it overlaps most."""
    best, found = OVERLAP, None
    for name, box in true.items():
        part = assembly.parts[name]
        if part.detector_class != detection.label:
            continue
        if len(detection.keypoints_px) != len(part.keypoints):
            continue
        overlap = float(iou_matrix(box[None], detection.box_xyxy[None])[0, 0])
        if overlap >= best:
            best, found = overlap, name
    return found


def measure_keypoints(boxes: Sequence[KnownBox]) -> KeypointFigures | None:
    """Compare scores with distances, and PnP with scores with PnP without; None of no boxes."""
    if not boxes:
        return None
    scores = np.concatenate([box.detection.keypoint_scores for box in boxes])
    off = np.concatenate([_off(box) for box in boxes])
    turned = [angles for box in boxes if (angles := _turned(box)) is not None]
    medians = np.median(np.rad2deg(turned), axis=0).tolist() if turned else (None, None)
    return KeypointFigures(
        boxes=len(boxes),
        bins=_bins(scores, off),
        rank_correlation=float(np.corrcoef(_ranks(scores), _ranks(off))[0, 1]),
        solved=len(turned),
        turned_deg_median=medians[0],
        turned_deg_median_alike=medians[1],
    )


def _off(box: KnownBox) -> Scores:
    """How far each keypoint is from the true one, as a share of the box's diagonal."""
    T_camera_part = canonical(box.T_camera_part, box.part.symmetries)
    true = project(apply(T_camera_part, box.part.keypoints), box.camera.K)
    x0, y0, x1, y1 = box.detection.box_xyxy
    return np.linalg.norm(box.detection.keypoints_px - true, axis=1) / np.hypot(x1 - x0, y1 - y0)


def _turned(box: KnownBox) -> tuple[float, float] | None:
    """How far off the rotation is by PnP with scores and without, radians; None where one finds none."""
    weighted, alike = (_solved(box, scores) for scores in (box.detection.keypoint_scores, None))
    if weighted is None or alike is None:
        return None
    part, T_true = box.part, box.T_camera_part
    return (
        symmetric_angle(T_true, weighted.T_camera_part, part.symmetries),
        symmetric_angle(T_true, alike.T_camera_part, part.symmetries),
    )


def _solved(box: KnownBox, scores: Scores | None) -> PnpSolution | None:
    return solve_pnp(
        box.part.keypoints,
        box.detection.keypoints_px,
        box.camera.K,
        config=ROBUST_PNP,
        scores=scores,
        box_xyxy=box.detection.box_xyxy,
        image_width=box.camera.width,
    )


def _bins(scores: Scores, off: Scores) -> tuple[ScoreBin, ...]:
    """Equal bins of scores; empty ones are left out."""
    place = np.clip((scores * BINS).astype(int), 0, BINS - 1)
    return tuple(
        ScoreBin(float(scores[inside].mean()), int(inside.sum()), float(np.median(off[inside])))
        for inside in (place == k for k in range(BINS))
        if inside.any()
    )


def _ranks(values: Scores) -> Scores:
    return np.argsort(np.argsort(values, kind="stable"), kind="stable").astype(np.float64)


def keypoint_table(figures: KeypointFigures) -> str:
    """What was measured, as text."""
    lines = [
        f"{figures.boxes} boxes of parts",
        f"{'score':>6}{'keypoints':>11}{'off, share of the box':>23}",
    ]
    lines += [f"{b.score:6.2f}{b.count:11}{b.off_median:23.3f}" for b in figures.bins]
    lines.append(f"rank correlation of score and distance: {figures.rank_correlation:.2f}")
    if figures.turned_deg_median is not None:
        lines.append(
            f"PnP of {figures.solved}, rotation off in the median: {figures.turned_deg_median:.1f} deg "
            f"with scores, {figures.turned_deg_median_alike:.1f} deg with all alike"
        )
    return "\n".join(lines)
