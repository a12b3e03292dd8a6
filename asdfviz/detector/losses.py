"""The training losses: boxes, classes, keypoints and their visibility.

Gains and forms are YOLOv8-pose's; the keypoint tolerance is our own and not that of human joints,
for which the published 17-point loss takes an assembly part.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from asdfviz.detector.assigner import AssignerConfig, Assignment, Targets, assign, ciou
from asdfviz.detector.head import BINS, RawOutput, decode_boxes, decode_keypoints

PositiveValues: TypeAlias = Float[Tensor, "p"]
"""One number a positive anchor."""

COCO_SIGMAS = tuple(
    s / 10
    for s in (
        0.26,
        0.25,
        0.25,
        0.35,
        0.35,
        0.79,
        0.79,
        0.72,
        0.72,
        0.62,
        0.62,
        1.07,
        1.07,
        0.87,
        0.87,
        0.89,
        0.89,
    )
)
"""Tolerances of human joints, nose to ankles: what the published loss uses for any 17 points."""


@dataclass(frozen=True, slots=True)
class LossConfig:
    """Weights and forms of the losses."""

    keypoints: Literal["mix", "oks", "l2"] = "mix"
    """mix: OKS plus a distance in box sizes; oks: published; l2: squared distance (the paper)."""
    sigmas: tuple[float, ...] = (0.04,)
    """OKS tolerance of each keypoint, or one for all; share of the object's size."""
    distance_weight: float = 0.35
    """Share of the distance term in `mix`; a saturating OKS alone starts flat."""
    occluded_weight: float = 0.6
    """Weight of keypoints that something hides, the part itself included."""
    visible_only: bool = True
    """Teach the visibility output true visibility; False: whether the point is labelled."""
    box_gain: float = 7.5
    class_gain: float = 0.5
    bins_gain: float = 1.5
    keypoint_gain: float = 16.0
    """12 in YOLOv8."""
    visibility_gain: float = 1.0
    assigner: AssignerConfig = field(default_factory=lambda: AssignerConfig(nearest=True))


PUBLISHED = LossConfig(
    keypoints="oks",
    sigmas=COCO_SIGMAS,
    occluded_weight=1.0,
    visible_only=False,
    keypoint_gain=12.0,
    assigner=AssignerConfig(),
)
"""The loss of the public network, to the digit."""

PAPER = LossConfig(keypoints="l2", keypoint_gain=12.0, occluded_weight=1.0, visible_only=False)
"""L2 keypoints and cross-entropy classes, as the paper describes its training."""


@dataclass(frozen=True, slots=True, eq=False)
class Losses:
    """Weighted parts of the loss, mean over the batch's images as YOLOv8 counts them."""

    box: Float[Tensor, ""]
    keypoint: Float[Tensor, ""]
    visibility: Float[Tensor, ""]
    classes: Float[Tensor, ""]
    bins: Float[Tensor, ""]

    @property
    def parts(self) -> Float[Tensor, 5]:
        """All five, in the order above."""
        return torch.stack([self.box, self.keypoint, self.visibility, self.classes, self.bins])


def pose_losses(
    raw: RawOutput, targets: Targets, *, config: LossConfig
) -> tuple[Losses, Assignment]:
    """Return the weighted losses of a batch and who learned what."""
    scores = raw.scores.transpose(1, 2)
    boxes = decode_boxes(raw)
    stride = raw.strides[:, None]
    assignment = assign(
        scores.detach().sigmoid(),
        boxes.detach() * stride,
        raw.anchors * stride,
        raw.strides,
        targets,
        config=config.assigner,
    )
    total = assignment.scores.sum().clamp(min=1)
    classes = functional.binary_cross_entropy_with_logits(
        scores, assignment.scores, reduction="sum"
    )
    picked = _pick(raw, boxes, targets, assignment)
    box, bins = _box_losses(picked, total)
    keypoint, visibility = _keypoint_losses(picked, config)
    losses = Losses(
        box=box * config.box_gain,
        keypoint=keypoint * config.keypoint_gain,
        visibility=visibility * config.visibility_gain,
        classes=classes / total * config.class_gain,
        bins=bins * config.bins_gain,
    )
    return losses, assignment


@dataclass(frozen=True, slots=True, eq=False)
class _Picked:
    """The positive anchors' predictions and targets, in stride units."""

    anchors: Float[Tensor, "p 2"]
    bins: Float[Tensor, "p 4 16"]
    boxes: Float[Tensor, "p 4"]
    points: Float[Tensor, "p k 2"]
    visible: Float[Tensor, "p k"]
    weights: PositiveValues
    target_boxes: Float[Tensor, "p 4"]
    target_points: Float[Tensor, "p k 3"]


def _pick(raw: RawOutput, boxes: Tensor, targets: Targets, assignment: Assignment) -> _Picked:
    image, anchor = assignment.positive.nonzero(as_tuple=True)
    row = assignment.objects[image, anchor]
    stride = raw.strides[anchor]
    points, visible = decode_keypoints(raw)
    target_points = targets.keypoints[image, row].clone()
    target_points[..., :2] /= stride[:, None, None]
    return _Picked(
        anchors=raw.anchors[anchor],
        bins=raw.boxes[image, :, anchor].view(-1, 4, BINS),
        boxes=boxes[image, anchor],
        points=points[image, anchor],
        visible=visible[image, anchor],
        weights=assignment.scores[image, anchor].sum(-1),
        target_boxes=targets.boxes[image, row] / stride[:, None],
        target_points=target_points,
    )


def _box_losses(picked: _Picked, total: Tensor) -> tuple[Tensor, Tensor]:
    """CIoU, and the distribution of the four sides (Li et al. 2020, generalized focal loss)."""
    box = ((1 - ciou(picked.boxes, picked.target_boxes)) * picked.weights).sum() / total
    low, high = picked.target_boxes[:, :2], picked.target_boxes[:, 2:]
    sides = torch.cat([picked.anchors - low, high - picked.anchors], 1).clamp(0, BINS - 1 - 0.01)
    left = sides.long()
    share = left + 1 - sides
    logits = picked.bins.log_softmax(2)
    at_left = logits.gather(2, left[..., None])[..., 0]
    at_right = logits.gather(2, left[..., None] + 1)[..., 0]
    bins = -(at_left * share + at_right * (1 - share)).mean(1)
    return box, (bins * picked.weights).sum() / total


def _keypoint_losses(picked: _Picked, config: LossConfig) -> tuple[Tensor, Tensor]:
    """Distance and visibility of the keypoints, mean over positives; 0 where there are none."""
    if not len(picked.points):
        nothing = picked.points.sum() * 0.0
        return nothing, picked.visible.sum() * 0.0
    flags = picked.target_points[..., 2]
    labelled = flags > 0
    size = picked.target_boxes[:, 2:] - picked.target_boxes[:, :2]
    area = size.prod(1)[:, None]
    squared = ((picked.points - picked.target_points[..., :2]) ** 2).sum(-1)
    error = _keypoint_error(squared, area, config)
    weight = torch.where(flags >= 2, 1.0, config.occluded_weight) * labelled
    count = labelled.sum(1, keepdim=True)
    factor = flags.shape[1] / (count + 1e-9)
    distance = factor * error * weight
    if not config.visible_only:
        target = labelled.float()
        return distance.mean(), functional.binary_cross_entropy_with_logits(picked.visible, target)
    rows = (count[:, 0] > 0).sum().clamp(min=1)
    binary = functional.binary_cross_entropy_with_logits(
        picked.visible, (flags >= 2).float(), reduction="none"
    )
    mean = rows * flags.shape[1]
    return distance.sum() / mean, (binary * labelled).sum() / mean


def _keypoint_error(squared: Tensor, area: Tensor, config: LossConfig) -> Tensor:
    """Error of each keypoint from its squared distance, all in stride units."""
    if config.keypoints == "l2":
        return squared / (area + 1e-9)
    sigmas = torch.tensor(config.sigmas, device=squared.device)
    oks = 1 - torch.exp(-squared / (2 * sigmas) ** 2 / (area + 1e-9) / 2)
    if config.keypoints == "oks":
        return oks
    # A twentieth of the box's size counts as one; the 0.04 rounds the tip off.
    distance = torch.sqrt(squared / (0.05**2 * area + 1e-9) + 0.04)
    return oks + config.distance_weight * distance
