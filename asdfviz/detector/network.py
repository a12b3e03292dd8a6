"""YOLOv8-pose in its public sizes (n s m l x, and x-p6 with a fourth level).

Written from the published layer table; a state dict of the public network of the same size loads
key by key. `keypoint_width` widens the keypoint branch of our own weights.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

from jaxtyping import Float
from torch import Tensor, nn

from asdfviz.datatypes import KEYPOINTS
from asdfviz.detector.blocks import C2, SPPF, C2f, Concat, Conv, Upsample
from asdfviz.detector.head import PoseHead, RawOutput

Scale: TypeAlias = Literal["n", "s", "m", "l", "x", "x-p6"]


@dataclass(frozen=True, slots=True)
class _Size:
    depth: float
    width: float
    limit: int


_SIZES: dict[str, _Size] = {
    "n": _Size(0.33, 0.25, 1024),
    "s": _Size(0.33, 0.50, 1024),
    "m": _Size(0.67, 0.75, 768),
    "l": _Size(1.0, 1.0, 512),
    "x": _Size(1.0, 1.25, 512),
    "x-p6": _Size(1.0, 1.25, 512),
}


def strides_of(scale: Scale) -> tuple[int, ...]:
    """Input pixels a cell of each level of a network of this size."""
    return (8, 16, 32, 64) if scale.endswith("p6") else (8, 16, 32)


class Network(nn.Module):
    """Backbone, neck and pose head; `model` holds the layers under the public numbers."""

    def __init__(
        self,
        scale: Scale,
        *,
        classes: int,
        keypoints: int = KEYPOINTS,
        keypoint_width: int | None = None,
    ) -> None:
        """Build the network with random weights.

        Args:
            scale: public size.
            classes: number of classes.
            keypoints: number of keypoints of every class.
            keypoint_width: hidden channels of the keypoint branch; None is the public width
                (51 in size n), 128 or more learns several unlike parts better.
        """
        super().__init__()
        self.scale: Scale = scale
        self.classes = classes
        self.keypoints = keypoints
        self.keypoint_width = keypoint_width
        plan = _Plan(_SIZES[scale])
        (_plan_p6 if scale.endswith("p6") else _plan_p5)(plan)
        self.strides = strides_of(scale)
        head = PoseHead(
            tuple(plan.channels[i] for i in plan.outputs),
            self.strides,
            classes=classes,
            keypoints=keypoints,
            keypoint_width=keypoint_width,
        )
        self.model = nn.ModuleList([*plan.layers, head])
        self._joined = plan.joined
        self._outputs = plan.outputs

    @property
    def head(self) -> PoseHead:
        """The last layer."""
        head = self.model[-1]
        assert isinstance(head, PoseHead)
        return head

    def forward(self, images: Float[Tensor, "b 3 h w"]) -> RawOutput:
        """Run the network on RGB images in 0 to 1 whose sides are multiples of the last stride."""
        x = images
        kept: list[Tensor] = []
        for index, layer in enumerate(self.model[:-1]):
            x = layer([x, kept[self._joined[index]]] if index in self._joined else x)
            kept.append(x)
        return self.model[-1]([kept[i] for i in self._outputs])

    def fuse(self) -> Network:
        """Fold every batch norm into its convolution; for inference only. Returns itself."""
        for module in self.modules():
            if isinstance(module, Conv):
                module.fuse()
        return self


class _Plan:
    """Lists the layers in order while they are described."""

    def __init__(self, size: _Size) -> None:
        self.size = size
        self.layers: list[nn.Module] = []
        self.channels: list[int] = []
        self.joined: dict[int, int] = {}
        self.outputs: tuple[int, ...] = ()

    @property
    def _last(self) -> int:
        return self.channels[-1] if self.channels else 3

    def width(self, channels: int) -> int:
        """Channels of this size: limited, scaled, rounded up to a multiple of eight."""
        return math.ceil(min(channels, self.size.limit) * self.size.width / 8) * 8

    def repeats(self, count: int) -> int:
        return max(round(count * self.size.depth), 1)

    def _add(self, layer: nn.Module, channels: int) -> None:
        self.layers.append(layer)
        self.channels.append(channels)

    def down(self, channels: int) -> None:
        out = self.width(channels)
        self._add(Conv(self._last, out, 3, stride=2), out)

    def csp(self, channels: int, count: int, *, shortcut: bool, full: bool = True) -> None:
        out = self.width(channels)
        kind = C2f if full else C2
        self._add(kind(self._last, out, self.repeats(count), shortcut=shortcut), out)

    def pool(self, channels: int) -> None:
        out = self.width(channels)
        self._add(SPPF(self._last, out), out)

    def up(self) -> None:
        self._add(Upsample(), self._last)

    def join(self, index: int) -> None:
        self.joined[len(self.layers)] = index
        self._add(Concat(), self._last + self.channels[index])


def _plan_backbone(plan: _Plan) -> None:
    plan.down(64)
    plan.down(128)
    plan.csp(128, 3, shortcut=True)
    plan.down(256)
    plan.csp(256, 6, shortcut=True)
    plan.down(512)
    plan.csp(512, 6, shortcut=True)


def _plan_p5(plan: _Plan) -> None:
    _plan_backbone(plan)
    plan.down(1024)
    plan.csp(1024, 3, shortcut=True)
    plan.pool(1024)
    for joined, channels in ((6, 512), (4, 256)):
        plan.up()
        plan.join(joined)
        plan.csp(channels, 3, shortcut=False)
    for joined, before, channels in ((12, 256, 512), (9, 512, 1024)):
        plan.down(before)
        plan.join(joined)
        plan.csp(channels, 3, shortcut=False)
    plan.outputs = (15, 18, 21)


def _plan_p6(plan: _Plan) -> None:
    _plan_backbone(plan)
    for channels in (768, 1024):
        plan.down(channels)
        plan.csp(channels, 3, shortcut=True)
    plan.pool(1024)
    for joined, channels in ((8, 768), (6, 512), (4, 256)):
        plan.up()
        plan.join(joined)
        plan.csp(channels, 3, shortcut=False, full=False)
    for joined, before, channels in ((17, 256, 512), (14, 512, 768), (11, 768, 1024)):
        plan.down(before)
        plan.join(joined)
        plan.csp(channels, 3, shortcut=False, full=False)
    plan.outputs = (20, 23, 26, 29)
