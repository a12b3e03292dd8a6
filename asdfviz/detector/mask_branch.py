"""Instance masks beside a trained detector: prototypes from its finest features, a few numbers a box.

After YOLACT (Bolya et al. 2019), in the form of YOLOv8-seg: a mask is the sigmoid of prototype
images, summed with the coefficients of the anchor that gave the box, and cut to the box. The
branch only reads the neck's features, so boxes and keypoints stay what they are without it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor, nn

from asdfviz.detector.blocks import Conv, Upsample
from asdfviz.detector.letterbox import Letterbox
from asdfviz.geometry.boxes import BoxMask
from asdfviz.geometry.shapes import Box, Mask

PROTOTYPES = 32
"""Prototype images, and coefficients an anchor, as in both publications."""
WIDTH = 48
"""Channels of the prototype net; the smallest YOLOv8-seg has 64."""
STRIDE = 4
"""Pixels of the network's input a pixel of the prototypes."""

Coefficients: TypeAlias = Float32[np.ndarray, "prototypes"]
"""Of one anchor."""


@dataclass(frozen=True, slots=True, eq=False)
class RawMasks:
    """What the branch puts out for a batch."""

    prototypes: Float[Tensor, "b p h w"]
    """At stride 4 of the network's input."""
    coefficients: Float[Tensor, "b p a"]
    """One column an anchor, in the order of the head's outputs."""


class MaskBranch(nn.Module):
    """A prototype net on the finest features and a coefficient branch on every level."""

    def __init__(
        self, channels: tuple[int, ...], *, prototypes: int = PROTOTYPES, width: int = WIDTH
    ) -> None:
        """Build the branch with random weights.

        Args:
            channels: of the detector's neck by level, finest (stride 8) first.
            prototypes: images, and coefficients an anchor.
            width: channels of the prototype net.
        """
        super().__init__()
        self.channels, self.width = channels, width
        hidden = prototypes
        self.prototypes = nn.Sequential(
            Conv(channels[0], width, 3),
            Upsample(),
            Conv(width, width, 3),
            Conv(width, prototypes),
        )
        self.coefficients = nn.ModuleList(
            nn.Sequential(
                Conv(c, hidden, 3), Conv(hidden, hidden, 3), nn.Conv2d(hidden, prototypes, 1)
            )
            for c in channels
        )

    def forward(self, maps: tuple[Tensor, ...]) -> RawMasks:
        """Run on the neck's features, finest first."""
        columns = [branch(x).flatten(2) for branch, x in zip(self.coefficients, maps, strict=True)]
        return RawMasks(self.prototypes(maps[0]).float(), torch.cat(columns, 2).float())

    def fuse(self) -> MaskBranch:
        """Fold every batch norm into its convolution; for inference only. Returns itself."""
        for module in self.modules():
            if isinstance(module, Conv):
                module.fuse()
        return self


def box_mask(
    coefficients: Coefficients,
    prototypes: Float32[np.ndarray, "prototypes h w"],
    *,
    box_xyxy: Box,
    plan: Letterbox,
    size_wh: tuple[int, int],
) -> BoxMask | None:
    """The mask of one detection: pixels of its box whose probability is one half or more.

    Args:
        coefficients: of the anchor that gave the box.
        prototypes: of the picture.
        box_xyxy: in pixels of the frame.
        plan: how the frame lies in the network's input.
        size_wh: of the frame.

    Returns:
        None where the box holds no pixel of the frame.
    """
    left, top = np.clip(np.ceil(box_xyxy[:2]), 0, size_wh).astype(int)
    right, bottom = np.clip(np.floor(box_xyxy[2:]) + 1, 0, size_wh).astype(int)
    if right <= left or bottom <= top:
        return None
    # Frame pixels to prototype pixels, both with the integer at a pixel's centre.
    scale = np.array([plan.scale_x, plan.scale_y]) / STRIDE
    first = plan.to_network(np.array([left, top], np.float64)) / STRIDE - 0.5
    last = first + scale * [right - left - 1, bottom - top - 1]
    low = np.maximum(np.floor(first).astype(int), 0)
    high = np.minimum(np.ceil(last).astype(int) + 1, prototypes.shape[:0:-1])
    part = prototypes[:, low[1] : high[1], low[0] : high[0]]
    logits = np.tensordot(coefficients, part, axes=1)
    M = np.array([[scale[0], 0.0, first[0] - low[0]], [0.0, scale[1], first[1] - low[1]]])
    fine = cv2.warpAffine(
        logits,
        M,
        (int(right - left), int(bottom - top)),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    pixels: Mask = np.asarray(fine >= 0)
    return BoxMask(int(left), int(top), pixels)
