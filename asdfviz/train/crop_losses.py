"""What a crop network is taught, as numbers: rotation, place, outline and state."""

from __future__ import annotations

import torch
from jaxtyping import Float32
from torch import Tensor
from torch.nn.functional import (
    binary_cross_entropy_with_logits,
    cross_entropy,
    log_softmax,
    smooth_l1_loss,
)

from asdfviz.detector.crop_network import CropOutput
from asdfviz.train.crop_views import ViewMaker, Views

LOSSES = ("rotation", "place", "outline", "state")
"""Names of what `crop_losses` returns."""


def crop_losses(
    out: CropOutput, batch: Views, *, target: Float32[Tensor, "b g"], views: ViewMaker
) -> Float32[Tensor, "4"]:
    """The losses in the order of `LOSSES`.

    Args:
        out: of the network.
        batch: what it was shown.
        target: distribution over the grid, as `ViewMaker.targets` gives it.
        views: knows which states each group has.
    """
    rotation = -(target * log_softmax(out.rotations.float(), dim=1)).sum(1).mean()
    place = smooth_l1_loss(out.place.float(), batch.place, beta=0.1)
    outline = binary_cross_entropy_with_logits(out.outline.float(), batch.outline)
    # Cross-entropy among the states of each group; what shows a part says nothing.
    rows = batch.states >= 0
    own = views.own_states(out.states[rows].float(), batch.labels[rows])
    missed = cross_entropy(own, batch.states[rows], reduction="sum") / rows.sum().clamp(min=1)
    return torch.stack([rotation, place, outline, missed])
