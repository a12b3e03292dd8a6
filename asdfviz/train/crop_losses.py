"""What a crop network is taught, as numbers: rotation, place, outline, state and name."""

from __future__ import annotations

import torch
from jaxtyping import Float, Float32
from torch import Tensor
from torch.nn.functional import (
    binary_cross_entropy_with_logits,
    cross_entropy,
    log_softmax,
    smooth_l1_loss,
)

from asdfviz.detector.crop_network import CropOutput
from asdfviz.train.crop_views import ViewMaker, Views

LOSSES = ("rotation", "place", "outline", "state", "name")
"""Names of what `crop_losses` returns."""
SMOOTHING = 0.02
"""Share of a name's probability that all names share: boxes and covers leave some doubt."""


def crop_losses(
    out: CropOutput,
    names: Float[Tensor, "b n"],
    batch: Views,
    *,
    target: Float32[Tensor, "b g"],
    views: ViewMaker,
) -> Float32[Tensor, "5"]:
    """The losses in the order of `LOSSES`.

    Args:
        out: of the network.
        names: of the network; none where it is not taught them.
        batch: what it was shown.
        target: distribution over the grid, as `ViewMaker.targets` gives it.
        views: knows which states each group has.
    """
    known = batch.names != views.nothing  # crops of nothing known have no pose
    likelihood = log_softmax(out.rotations[known].float(), dim=1)
    rotation = -(target[known] * likelihood).sum() / max(len(likelihood), 1)
    moved = smooth_l1_loss(out.place[known].float(), batch.place[known], beta=0.1, reduction="sum")
    place = moved / max(batch.place[known].numel(), 1)
    drawn = known & ~batch.outline[:, 0, 0].isnan()
    missed_cells = binary_cross_entropy_with_logits(
        out.outline[drawn].float(), batch.outline[drawn], reduction="sum"
    )
    outline = missed_cells / max(batch.outline[drawn].numel(), 1)
    # Cross-entropy among the states of each group; what shows a part says nothing.
    rows = batch.states >= 0
    own = views.own_states(out.states[rows].float(), batch.labels[rows])
    missed = cross_entropy(own, batch.states[rows], reduction="sum") / rows.sum().clamp(min=1)
    return torch.stack([rotation, place, outline, missed, misnamed(names, batch)])


def misnamed(names: Float[Tensor, "b n"], batch: Views) -> Float32[Tensor, ""]:
    """Cross-entropy among all names; what shows a group says nothing."""
    rows = batch.names >= 0
    if not names.shape[1]:
        return names.new_zeros(()).float()
    missed = cross_entropy(
        names[rows].float(), batch.names[rows], reduction="sum", label_smoothing=SMOOTHING
    )
    return missed / rows.sum().clamp(min=1)
