"""The three branches of the network and what their numbers mean: boxes, classes, keypoints.

Pixel coordinates here are the network's own: the centre of the input's first pixel is (0.5, 0.5).
`letterbox` maps them to frames, where an integer is a pixel's centre.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias, cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from asdfviz.detector.blocks import Conv

BINS = 16
"""Bins of the distribution of each box side, in strides."""


AnchorValues: TypeAlias = Float[Tensor, "a"]
"""One number an anchor."""


@dataclass(frozen=True, slots=True, eq=False)
class RawOutput:
    """The head's numbers of all levels, finest first, one column an anchor, before decoding."""

    boxes: Float[Tensor, "b 64 a"]
    """Logits over the 16 bins of left, top, right, bottom."""
    scores: Float[Tensor, "b classes a"]
    """Logits."""
    keypoints: Float[Tensor, "b k3 a"]
    """x, y, visibility logit of each keypoint."""
    anchors: Float[Tensor, "a 2"]
    """Cell centres in stride units (integer + 0.5)."""
    strides: AnchorValues
    """Pixels a cell."""
    features: tuple[Tensor, ...] = ()
    """Last hidden features of the keypoint branch by level, for auxiliary losses in training."""
    maps: tuple[Tensor, ...] = ()
    """The neck's features by level, which all branches read: a mask branch reads them too."""


class PoseHead(nn.Module):
    """Box, class and keypoint branch on every level (cv2, cv3 and cv4 of the public layout)."""

    def __init__(
        self,
        channels: tuple[int, ...],
        strides: tuple[int, ...],
        *,
        classes: int,
        keypoints: int,
        keypoint_width: int | None = None,
    ) -> None:
        super().__init__()
        self.strides = strides
        outputs = keypoints * 3
        box_width = max(16, channels[0] // 4, BINS * 4)
        class_width = max(channels[0], min(classes, 100))
        width = keypoint_width or max(channels[0] // 4, outputs)
        self.cv2 = nn.ModuleList(_branch(c, box_width, 4 * BINS) for c in channels)
        self.cv3 = nn.ModuleList(_branch(c, class_width, classes) for c in channels)
        self.dfl = _Expectation()
        self.cv4 = nn.ModuleList(_branch(c, width, outputs) for c in channels)
        self._start_biases(classes)

    def _start_biases(self, classes: int) -> None:
        """Start with boxes of some cells and about five objects in a 640 px image."""
        for boxes, scores, stride in zip(self.cv2, self.cv3, self.strides, strict=True):
            _bias(boxes).data.fill_(1.0)
            _bias(scores).data.fill_(math.log(5 / classes / (640 / stride) ** 2))

    def forward(self, maps: list[Tensor]) -> RawOutput:
        """Run the branches on the feature maps, finest first; outputs are float32."""
        boxes: list[Tensor] = []
        scores: list[Tensor] = []
        keypoints: list[Tensor] = []
        features: list[Tensor] = []
        hidden = maps[0]
        for level, x in enumerate(maps):
            for branches, outputs in ((self.cv2, boxes), (self.cv3, scores), (self.cv4, keypoints)):
                hidden, out = _run_branch(branches[level], x)
                outputs.append(out)
            features.append(hidden)
        anchors, strides = anchor_points(maps, self.strides)
        return RawOutput(
            boxes=torch.cat(boxes, 2),
            scores=torch.cat(scores, 2),
            keypoints=torch.cat(keypoints, 2),
            anchors=anchors,
            strides=strides,
            features=tuple(features),
            maps=tuple(maps),
        )


class _Expectation(nn.Module):
    """Holds the bin numbers 0 to 15 as the fixed convolution that the public layout has."""

    def __init__(self) -> None:
        super().__init__()
        self.conv = nn.Conv2d(BINS, 1, 1, bias=False).requires_grad_(False)
        self.conv.weight.data.copy_(torch.arange(BINS, dtype=torch.float32).view(1, BINS, 1, 1))


def _branch(inputs: int, width: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        Conv(inputs, width, 3), Conv(width, width, 3), nn.Conv2d(width, outputs, 1)
    )


def _run_branch(branch: nn.Module, x: Tensor) -> tuple[Tensor, Tensor]:
    """Return the last hidden features and the outputs (channels, anchors) of a branch.

    The outputs are computed in single precision: bfloat16 would round keypoints by up to a pixel.
    """
    layers = cast(nn.Sequential, branch)
    hidden = layers[1](layers[0](x))
    with torch.autocast(x.device.type, enabled=False):
        return hidden, layers[2](hidden.float()).flatten(2)


def _bias(branch: nn.Module) -> Tensor:
    return cast(Tensor, cast(nn.Conv2d, cast(nn.Sequential, branch)[-1]).bias)


def anchor_points(
    maps: list[Tensor], strides: tuple[int, ...]
) -> tuple[Float[Tensor, "a 2"], AnchorValues]:
    """Return the cell centres of all levels in stride units, and each one's stride in pixels."""
    centres: list[Tensor] = []
    sizes: list[Tensor] = []
    for x, stride in zip(maps, strides, strict=True):
        h, w = x.shape[-2:]
        rows = torch.arange(h, device=x.device, dtype=torch.float32) + 0.5
        columns = torch.arange(w, device=x.device, dtype=torch.float32) + 0.5
        grid_y, grid_x = torch.meshgrid(rows, columns, indexing="ij")
        centres.append(torch.stack([grid_x, grid_y], dim=-1).view(-1, 2))
        sizes.append(torch.full((h * w,), float(stride), device=x.device))
    return torch.cat(centres), torch.cat(sizes)


def decode_boxes(raw: RawOutput) -> Float[Tensor, "b a 4"]:
    """Return x0, y0, x1, y1 in stride units: the expected distance of each side from the anchor."""
    batch, _, anchors = raw.boxes.shape
    probabilities = raw.boxes.view(batch, 4, BINS, anchors).softmax(2)
    bins = torch.arange(BINS, device=raw.boxes.device, dtype=torch.float32)
    sides = torch.einsum("bsna,n->bas", probabilities, bins)
    return torch.cat([raw.anchors - sides[..., :2], raw.anchors + sides[..., 2:]], dim=-1)


def decode_keypoints(raw: RawOutput) -> tuple[Float[Tensor, "b a k 2"], Float[Tensor, "b a k"]]:
    """Return keypoints in stride units, twice the raw value off the cell's corner, and logits."""
    batch, outputs, anchors = raw.keypoints.shape
    values = raw.keypoints.view(batch, outputs // 3, 3, anchors).permute(0, 3, 1, 2)
    points = values[..., :2] * 2.0 + (raw.anchors - 0.5)[None, :, None, :]
    return points, values[..., 2]


def decode(raw: RawOutput) -> Float[Tensor, "b n a"]:
    """Return centre x, y, width, height, class scores and (x, y, visible) keypoints, in pixels."""
    stride = raw.strides[None, :, None]
    corners = decode_boxes(raw) * stride
    centre = (corners[..., :2] + corners[..., 2:]) / 2
    size = corners[..., 2:] - corners[..., :2]
    points, visible = decode_keypoints(raw)
    keypoints = torch.cat([points * stride[..., None], visible.sigmoid()[..., None]], dim=-1)
    columns = [centre, size, raw.scores.sigmoid().transpose(1, 2), keypoints.flatten(2)]
    return torch.cat(columns, dim=-1).transpose(1, 2)
