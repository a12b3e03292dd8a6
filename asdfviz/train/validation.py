"""Runs a network on pictures with labels and says how good its boxes, keypoints and poses are."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Detection, Part
from asdfviz.detector.detector import DetectorConfig, detect
from asdfviz.detector.joint import joint_classes, keep_classes, own_columns
from asdfviz.detector.network import Network
from asdfviz.geometry.boxes import iou_matrix
from asdfviz.geometry.shapes import Intrinsics, Transform
from asdfviz.geometry.symmetry import nearest_symmetric
from asdfviz.geometry.transforms import apply, rotation_angle
from asdfviz.pose.labels import LabelledObject
from asdfviz.pose.pnp import PnpConfig, solve_pnp
from asdfviz.train.augment import boxes_in
from asdfviz.train.dataset import LabelledImage

MATCH_IOU = 0.5
NEAR = 0.1
"""Metres: a pose counts from 1 where it is exact down to 0 at this distance."""
SCORE = "mean over parts of 1 - ADD(S) / 10 cm, 0 for each true part without a nearer pose"
"""What `Validation.score` is; a checkpoint keeps it, as older ones were chosen by another one."""
LOGGED = ("recall", "precision", "keypoint_px", "keypoint_share", "rotation_deg")
"""Fields of ClassScore that a run's log keeps."""


@dataclass(frozen=True, slots=True)
class ClassScore:
    """Figures of one class over the validation pictures; None where nothing was found."""

    label: str
    objects: int
    recall: float
    """Found with the right class, a score above the threshold and IoU >= 0.5 with what the picture
    holds of the box."""
    precision: float
    keypoint_px: float | None
    """Median over objects of the median keypoint distance, pixels."""
    keypoint_share: float | None
    """The same as a share of the box's size (root of its area)."""
    spread: float | None
    """Median size of the predicted keypoints over the true one; far below 1 is a collapse."""
    poses: float | None
    """Share of found objects for which PnP gives a pose."""
    rotation_deg: float | None
    """Median rotation error of those poses, symmetric poses counted as equal."""
    translation_mm: float | None
    """Median translation error of those poses."""


@dataclass(frozen=True, slots=True)
class Validation:
    """Figures of a network."""

    score: float
    """0 to 1, `SCORE`: the area under the recall at ADD(S) thresholds up to 10 cm, of poses by PnP from
    keypoints alone; picks the best checkpoint."""
    classes: tuple[ClassScore, ...]

    def as_json(self) -> dict[str, object]:
        """Plain numbers and lists."""
        return asdict(self)

    def columns(self) -> dict[str, float]:
        """The figures that are logged over a run, as "class:figure"; what is unknown is left out."""
        figures = ((f"{c.label}:{name}", getattr(c, name)) for c in self.classes for name in LOGGED)
        return {name: float(value) for name, value in figures if value is not None}

    def table(self) -> str:
        """One line a class, for people."""
        lines = [
            f"score {self.score:.3f}",
            f"{'class':<16}{'n':>5}{'rec':>6}{'prec':>6}{'px':>7}{'share':>7}{'spread':>7}"
            f"{'poses':>7}{'rot deg':>9}{'t mm':>8}",
        ]
        for c in self.classes:
            figures = (c.keypoint_px, c.keypoint_share, c.spread, c.poses)
            cells = "".join(f"{'-' if v is None else format(v, '.2f'):>7}" for v in figures)
            rotation = "-" if c.rotation_deg is None else f"{c.rotation_deg:.1f}"
            shift = "-" if c.translation_mm is None else f"{c.translation_mm:.0f}"
            lines.append(
                f"{c.label:<16}{c.objects:>5}{c.recall:>6.2f}{c.precision:>6.2f}{cells}"
                f"{rotation:>9}{shift:>8}"
            )
        return "\n".join(lines)


def _floats() -> list[float]:
    return []


@dataclass(slots=True)
class _Tally:
    objects: int = 0
    claims: int = 0
    found: int = 0
    pixels: list[float] = field(default_factory=_floats)
    shares: list[float] = field(default_factory=_floats)
    spreads: list[float] = field(default_factory=_floats)
    rotations: list[float] = field(default_factory=_floats)
    translations: list[float] = field(default_factory=_floats)
    distances: list[float] = field(default_factory=_floats)
    """ADD(S) of the poses, over the keypoints, to the nearest symmetric pose; metres."""


def validate(
    network: Network,
    images: Sequence[LabelledImage],
    assemblies: Sequence[Assembly],
    *,
    image_size: int,
    device: str = "cpu",
) -> Validation:
    """Run a network in evaluation mode on every picture and count.

    Args:
        network: with the classes of `joint_classes(assemblies)`.
        images: with labels; on each, only the classes of its own assembly are asked for.
        assemblies: give keypoints and symmetries for the poses.
        image_size: of the input, pixels.
        device: where the network is.
    """
    names = joint_classes(assemblies)
    tallies = [_Tally() for _ in names]
    config = DetectorConfig(image_size=image_size, device=device)
    part_labels: list[int] = []
    for assembly in assemblies:
        columns = own_columns(names, assembly.name)
        own = keep_classes(copy.deepcopy(network), tuple(columns.values()))
        classes = {part.detector_class for part in assembly.parts.values()}
        part_labels += [columns[name] for name in columns if name in classes]
        for image in images:
            if len(assemblies) == 1 or image.assembly == assembly.name:
                found = detect(own, image.rgb, classes=tuple(columns), config=config)
                for name, label in columns.items():
                    mine = [d for d in found if d.label == name]
                    _count_class(tallies[label], label, mine, image, assembly)
    accuracies = [_accuracy(tallies[label]) for label in part_labels if tallies[label].objects]
    return Validation(
        score=float(np.mean(accuracies)) if accuracies else 0.0,
        classes=tuple(map(_class_score, names, tallies)),
    )


def _count_class(
    tally: _Tally,
    label: int,
    found: Sequence[Detection],
    image: LabelledImage,
    assembly: Assembly,
) -> None:
    labels = image.stacked
    height, width = image.rgb.shape[:2]
    boxes, is_taught = boxes_in(
        labels, labels.outlines + np.float32(0.5), width=width, height=height
    )
    boxes = boxes.astype(np.float64) - 0.5
    mine = labels.labels == label
    objects = (mine & is_taught).nonzero()[0]
    pairs = list(_matches(boxes[objects], found))
    claimed = {row for _, row in pairs}
    others = [d for row, d in enumerate(found) if row not in claimed]
    # What lies so far outside that it is not taught need not be found, but may be.
    spared = list(_matches(boxes[mine & ~is_taught], others))
    tally.objects += len(objects)
    tally.claims += len(found) - len(spared)
    for place, row in pairs:
        _count(tally, image.objects[int(objects[place])], found[row], image.K, assembly, width)


def _matches(
    truth: Float64[np.ndarray, "m 4"], detections: Sequence[Detection]
) -> Iterable[tuple[int, int]]:
    """Pair each detection, best first, with the free box of highest IoU: places of box and detection."""
    if not len(truth) or not detections:
        return
    overlaps = iou_matrix(np.stack([d.box_xyxy for d in detections]), truth)
    free = np.ones(len(truth), bool)
    for row in range(len(detections)):
        place = int(np.where(free, overlaps[row], -1.0).argmax())
        if free[place] and overlaps[row, place] >= MATCH_IOU:
            free[place] = False
            yield place, row


def _count(
    tally: _Tally,
    item: LabelledObject,
    detection: Detection,
    K: Intrinsics,
    assembly: Assembly,
    width: int,
) -> None:
    tally.found += 1
    if item.part is None or item.T_camera_part is None:
        return
    true = item.keypoints[:, :2].astype(np.float64)
    distance = float(np.median(np.linalg.norm(detection.keypoints_px - true, axis=1)))
    width_px, height_px = item.outline.max(0) - item.outline.min(0)
    size = float(np.sqrt(width_px * height_px))
    tally.pixels.append(distance)
    tally.shares.append(distance / max(size, 1.0))
    tally.spreads.append(_extent(detection.keypoints_px) / max(_extent(true), 1.0))
    part = assembly.parts[item.part]
    T_camera_part = _pose(part, detection, K, width)
    if T_camera_part is None:
        return
    nearest = nearest_symmetric(T_camera_part, item.T_camera_part, part.symmetries)
    angle = rotation_angle(nearest[:3, :3].T @ item.T_camera_part[:3, :3])
    tally.rotations.append(float(np.degrees(angle)))
    shift = nearest[:3, 3] - item.T_camera_part[:3, 3]
    tally.translations.append(float(np.linalg.norm(shift)) * 1e3)
    apart = apply(nearest, part.keypoints) - apply(item.T_camera_part, part.keypoints)
    tally.distances.append(float(np.linalg.norm(apart, axis=1).mean()))


def _pose(part: Part, detection: Detection, K: Intrinsics, width: int) -> Transform | None:
    solution = solve_pnp(
        part.keypoints,
        detection.keypoints_px,
        K,
        config=PnpConfig(),
        box_xyxy=detection.box_xyxy,
        image_width=width,
    )
    return None if solution is None else solution.T_camera_part


def _extent(points: np.ndarray) -> float:
    return float(np.linalg.norm(points.std(axis=0)))


def _accuracy(tally: _Tally) -> float:
    """Mean over true objects of 1 for an exact pose falling to 0 at `NEAR`, 0 without a pose."""
    near = np.clip(1 - np.array(tally.distances) / NEAR, 0, 1)
    return float(near.sum() / max(tally.objects, 1))


def _class_score(name: str, tally: _Tally) -> ClassScore:
    def median(values: list[float]) -> float | None:
        return round(float(np.median(values)), 3) if values else None

    keypoints = len(tally.pixels)
    return ClassScore(
        label=name,
        objects=tally.objects,
        recall=round(tally.found / tally.objects, 3) if tally.objects else 0.0,
        precision=round(tally.found / tally.claims, 3) if tally.claims else 0.0,
        keypoint_px=median(tally.pixels),
        keypoint_share=median(tally.shares),
        spread=median(tally.spreads),
        poses=round(len(tally.rotations) / keypoints, 3) if keypoints else None,
        rotation_deg=median(tally.rotations),
        translation_mm=median(tally.translations),
    )
