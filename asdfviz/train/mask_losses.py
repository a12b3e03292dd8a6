"""The loss of a mask branch: binary cross-entropy and dice inside the true box of each object.

Cross-entropy over the box divided by its area as in YOLACT and YOLOv8-seg, so that small parts count
as much as large ones; dice (Milletari et al. 2016) beside it, for thin parts that fill little of
their box.
"""

from __future__ import annotations

from typing import Any, cast

import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor
from torch.nn import functional

from asdfviz.detector.assigner import Assignment
from asdfviz.detector.mask_branch import STRIDE, RawMasks
from asdfviz.train.mask_data import MaskBatch

LOSSES: tuple[str, ...] = ("cross_entropy", "dice")


def mask_losses(
    masks: RawMasks,
    assignment: Assignment,
    batch: MaskBatch,
    *,
    positives: int,
    margin: float,
) -> Float[Tensor, "2"]:
    """Cross-entropy and dice, means over the anchors that learn a mask; 0 where there are none.

    Args:
        masks: of the batch.
        assignment: which anchors learn which object.
        batch: with the truth.
        positives: anchors that take part at most, drawn at random.
        margin: share by which the true box is grown.
    """
    image, anchor = assignment.positive.nonzero(as_tuple=True)
    chosen = torch.randperm(len(image), device=image.device)[:positives].sort().values
    image, anchor = image[chosen], anchor[chosen]
    row = assignment.objects[image, anchor]
    total = masks.prototypes.new_zeros(2)
    for i in range(len(batch.images)):
        own = image == i
        if not bool(own.any()):
            continue
        unique = cast(Any, torch).unique(row[own], return_inverse=True)
        rows, place = cast(tuple[Tensor, Tensor], unique)
        prototypes = masks.prototypes[i]
        coefficients = masks.coefficients[i, :, anchor[own]].T
        logits = torch.einsum("np,phw->nhw", coefficients, prototypes)
        truth = shares(batch.owners[i], batch.places[i, rows])[place]
        inside = _in_boxes(batch.targets.boxes[i, rows], truth.shape[1:], margin)[place]
        total = total + _sums(logits, truth, inside)
    return total / max(len(image), 1)


def shares(owners: UInt8[Tensor, "h w"], places: UInt8[Tensor, "n"]) -> Float[Tensor, "n i j"]:
    """Which share of each prototype pixel shows each object, 0 to 1."""
    is_own = (owners[None] == places[:, None, None]).float()
    return functional.avg_pool2d(is_own[:, None], STRIDE)[:, 0]


def _in_boxes(
    boxes: Float[Tensor, "n 4"], size: torch.Size, margin: float
) -> Bool[Tensor, "n i j"]:
    """Prototype pixels whose centre lies in each grown box; at least one."""
    half = ((boxes[:, 2:] - boxes[:, :2]) * (0.5 + margin)).clamp(min=STRIDE / 2)
    middle = (boxes[:, :2] + boxes[:, 2:]) / 2
    low, high = middle - half, middle + half
    y = (torch.arange(size[0], device=boxes.device) + 0.5) * STRIDE
    x = (torch.arange(size[1], device=boxes.device) + 0.5) * STRIDE
    across = (x >= low[:, :1]) & (x <= high[:, :1])
    down = (y >= low[:, 1:]) & (y <= high[:, 1:])
    return down[:, :, None] & across[:, None]


def _sums(logits: Tensor, truth: Tensor, inside: Tensor) -> Float[Tensor, "2"]:
    """Both losses, summed over anchors."""
    inside = inside.float()
    area = inside.sum((1, 2)).clamp(min=1)
    pixels = functional.binary_cross_entropy_with_logits(logits, truth, reduction="none")
    entropy = (pixels * inside).sum((1, 2)) / area
    guess = logits.sigmoid() * inside
    both = (guess * truth).sum((1, 2))
    sizes = guess.sum((1, 2)) + (truth * inside).sum((1, 2))
    dice = 1 - (2 * both + 1) / (sizes + 1)
    return torch.stack([entropy.sum(), dice.sum()])
