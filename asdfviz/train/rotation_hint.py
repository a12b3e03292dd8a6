"""An auxiliary loss that teaches the keypoint branch to tell rotations apart.

Regressed keypoints of unsymmetric parts tend to stay at the part's middle, the mean of all
rotations. Telling which of some hundred rotations is seen has no such plateau, and the features
that it needs are the ones the keypoints need. The head is dropped after training.
"""

from __future__ import annotations

from typing import cast

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from asdfviz.detector.assigner import Assignment
from asdfviz.detector.head import RawOutput
from asdfviz.geometry.rotation_grid import even_rotations, rotations_of


class RotationHint(nn.Module):
    """A linear classifier of rotations for every class, on the keypoint branch's features."""

    grid: Tensor

    def __init__(self, *, classes: int, width: int, levels: int, rotations: int = 500) -> None:
        super().__init__()
        weight = torch.randn(levels, classes, width, rotations) * 0.01
        self.weight = nn.Parameter(weight)
        self.bias = nn.Parameter(torch.zeros(classes, rotations))
        grid = rotations_of(even_rotations(rotations))
        self.register_buffer("grid", torch.as_tensor(grid, dtype=torch.float32))
        # A third of the grid's spacing blurs each label over its nearest neighbours.
        self._blur = 1.1 * (np.pi**2 / rotations) ** (1 / 3)

    def forward(
        self,
        raw: RawOutput,
        assignment: Assignment,
        labels: Int64[Tensor, "b m"],
        rotations: Float[Tensor, "b m 3 3"],
    ) -> Float[Tensor, ""]:
        """Return the mean cross-entropy over positive anchors of parts."""
        features = torch.cat([f.float().flatten(2) for f in raw.features], 2)
        levels = torch.cat(
            [
                torch.full((f.shape[-2] * f.shape[-1],), i, device=features.device)
                for i, f in enumerate(raw.features)
            ]
        )
        image, anchor = assignment.positive.nonzero(as_tuple=True)
        row = assignment.objects[image, anchor]
        wanted, label = rotations[image, row], labels[image, row]
        is_part = wanted.abs().amax((1, 2)) > 0
        # Sorted by classifier, and none of them cut out of the tensor of all: a cut's gradient is
        # as large as the whole, and asking each which anchors it has makes a GPU wait every time.
        kinds = self.bias.shape[0]
        group = (levels[anchor] * kinds + label)[is_part]
        order = is_part.nonzero()[:, 0][group.argsort()]
        wanted, picked = wanted[order], features[image, :, anchor][order]
        found = group.bincount(minlength=self.weight.shape[0] * kinds)
        ends = cast(list[int], found.cumsum(0).tolist())  # pyright: ignore[reportUnknownMemberType] - untyped in torch
        biases = self.bias.unbind()
        logits: list[Tensor] = []
        for place, weight in enumerate(self.weight.flatten(0, 1).unbind()):
            mine = picked[ends[place - 1] if place else 0 : ends[place]]
            if len(mine):
                logits.append(torch.addmm(biases[place % kinds], mine, weight))
        if not logits:
            return features.sum() * 0.0
        soft = self._soft_labels(wanted)
        return -(soft * torch.cat(logits).log_softmax(1)).sum() / len(wanted)

    def _soft_labels(self, rotations: Float[Tensor, "p 3 3"]) -> Float[Tensor, "p r"]:
        trace = torch.einsum("pij,rij->pr", rotations, self.grid)
        angle = ((trace - 1) / 2).clamp(-1, 1).acos()
        return (-((angle / self._blur) ** 2)).softmax(1)
