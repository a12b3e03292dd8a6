"""Task-aligned assignment: which anchors are taught which object (TOOD, Feng et al. 2021).

An anchor suits an object as score^0.5 * CIoU^6; the ten best anchors inside an object's box learn
it, with a soft class target that grows with how well they suit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from asdfviz.detector.head import AnchorValues


@dataclass(frozen=True, slots=True)
class AssignerConfig:
    """Which anchors may learn an object."""

    candidates: int = 10
    """Anchors an object (top k)."""
    alpha: float = 0.5
    """Power of the class score."""
    beta: float = 6.0
    """Power of the CIoU."""
    nearest: bool = False
    """Teach an object whose box holds no anchor centre to the nearest anchor. The published
    assigner teaches such tiny boxes to nobody."""


@dataclass(frozen=True, slots=True, eq=False)
class Targets:
    """The labels of a batch, padded to the largest number of objects; network pixels."""

    labels: Int64[Tensor, "b m"]
    boxes: Float[Tensor, "b m 4"]
    """x0, y0, x1, y1."""
    keypoints: Float[Tensor, "b m k 3"]
    """x, y and visibility: 0 not labelled, 1 occluded, 2 visible."""
    present: Bool[Tensor, "b m"]
    """False where a row is padding."""


@dataclass(frozen=True, slots=True, eq=False)
class Assignment:
    """What each anchor learns."""

    positive: Bool[Tensor, "b a"]
    objects: Int64[Tensor, "b a"]
    """Row of Targets; meaningless where not positive."""
    scores: Float[Tensor, "b a classes"]
    """Soft class targets."""


def ciou(a: Float[Tensor, "*n 4"], b: Float[Tensor, "*m 4"]) -> Float[Tensor, "*o"]:
    """Complete IoU of boxes x0 y0 x1 y1 (Zheng et al. 2020); broadcasts."""
    eps = 1e-7
    (ax0, ay0, ax1, ay1), (bx0, by0, bx1, by1) = a.unbind(-1), b.unbind(-1)
    aw, ah, bw, bh = ax1 - ax0, ay1 - ay0 + eps, bx1 - bx0, by1 - by0 + eps
    overlap_w = (torch.minimum(ax1, bx1) - torch.maximum(ax0, bx0)).clamp(min=0)
    overlap_h = (torch.minimum(ay1, by1) - torch.maximum(ay0, by0)).clamp(min=0)
    overlap = overlap_w * overlap_h
    iou = overlap / (aw * ah + bw * bh - overlap + eps)
    hull_w = torch.maximum(ax1, bx1) - torch.minimum(ax0, bx0)
    hull_h = torch.maximum(ay1, by1) - torch.minimum(ay0, by0)
    diagonal = hull_w**2 + hull_h**2 + eps
    distance = ((bx0 + bx1 - ax0 - ax1) ** 2 + (by0 + by1 - ay0 - ay1) ** 2) / 4
    v = 4 / math.pi**2 * ((bw / bh).atan() - (aw / ah).atan()) ** 2
    with torch.no_grad():
        weight = v / (v - iou + 1 + eps)
    return iou - distance / diagonal - v * weight


@torch.no_grad()
def assign(
    scores: Float[Tensor, "b a classes"],
    boxes: Float[Tensor, "b a 4"],
    anchors: Float[Tensor, "a 2"],
    strides: AnchorValues,
    targets: Targets,
    *,
    config: AssignerConfig,
) -> Assignment:
    """Choose the anchors of every object.

    Args:
        scores: class probabilities of the network.
        boxes: its boxes, pixels.
        anchors: cell centres, pixels.
        strides: pixels a cell.
        targets: the labels.
        config: how many and which.
    """
    eps = 1e-9
    inside = _inside(anchors, strides, targets, nearest=config.nearest)
    # Few anchors lie in each box: a quarter of a training step went into comparing all with all.
    image, row, anchor = pairs = inside.nonzero(as_tuple=True)
    overlap = ciou(targets.boxes[image, row], boxes[image, anchor]).clamp(min=0)
    own_scores = scores[image, anchor, targets.labels[image, row]]
    overlaps = torch.zeros_like(inside, dtype=overlap.dtype).index_put_(pairs, overlap)
    fit = torch.zeros_like(overlaps).index_put_(
        pairs, own_scores**config.alpha * overlap**config.beta
    )

    best = torch.where(inside, fit, -1.0).topk(min(config.candidates, fit.shape[2]), dim=2).indices
    chosen = torch.zeros_like(inside).scatter_(2, best, True) & inside
    chosen = _settle_disputes(chosen, overlaps)

    fit = fit * chosen
    best_fit = fit.amax(2, keepdim=True)
    best_overlap = (overlaps * chosen).amax(2, keepdim=True)
    strength = (fit * best_overlap / (best_fit + eps)).amax(1)
    objects = chosen.int().argmax(1)
    positive = chosen.any(1)
    labels = targets.labels.gather(1, objects)
    soft = torch.zeros_like(scores).scatter_(2, labels[..., None], strength[..., None])
    return Assignment(positive=positive, objects=objects, scores=soft * positive[..., None])


def _inside(
    anchors: Tensor, strides: Tensor, targets: Targets, *, nearest: bool
) -> Bool[Tensor, "b m a"]:
    """Whether each anchor's centre lies in each box, padding excluded."""
    x0, y0, x1, y1 = (side[..., None] for side in targets.boxes.unbind(-1))
    x, y = anchors.unbind(-1)
    inside = (x > x0) & (x < x1) & (y > y0) & (y < y1) & targets.present[..., None]
    if not nearest:
        return inside
    orphans = targets.present & ~inside.any(2)
    if not bool(orphans.any()):
        return inside
    coarser = torch.where(strides == strides.min(), 0.0, 1e6)
    away = torch.hypot(x - (x0 + x1) / 2, y - (y0 + y1) / 2) + coarser
    closest = torch.zeros_like(inside).scatter_(2, away.argmin(2, keepdim=True), True)
    return inside | (closest & orphans[..., None])


def _settle_disputes(
    chosen: Bool[Tensor, "b m a"], overlaps: Float[Tensor, "b m a"]
) -> Bool[Tensor, "b m a"]:
    """Give an anchor that several objects chose to the one of highest CIoU."""
    disputed = chosen.sum(1, keepdim=True) > 1
    winner = torch.zeros_like(chosen).scatter_(1, overlaps.argmax(1, keepdim=True), True)
    return torch.where(disputed, winner, chosen)
