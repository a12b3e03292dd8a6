"""The building blocks of YOLOv8: convolution with batch norm, CSP blocks, pyramid pooling.

Attribute names are those of the public state dict, so that users' own checkpoints load.
"""

from __future__ import annotations

from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

BATCH_NORM_EPSILON = 1e-3
BATCH_NORM_MOMENTUM = 0.03


class Conv(nn.Module):
    """Convolution without bias, batch norm, SiLU. `fuse` folds the norm into the convolution."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 1, *, stride: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
        self.bn: nn.Module = nn.BatchNorm2d(
            outputs, eps=BATCH_NORM_EPSILON, momentum=BATCH_NORM_MOMENTUM
        )

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d i j"]:
        """Filter one feature map."""
        return nn.functional.silu(self.bn(self.conv(x)))

    @torch.no_grad()
    def fuse(self) -> None:
        """Fold the batch norm's running statistics into the convolution, for inference only."""
        if not isinstance(self.bn, nn.BatchNorm2d):
            return
        mean, variance = cast(Tensor, self.bn.running_mean), cast(Tensor, self.bn.running_var)
        gain = self.bn.weight / torch.sqrt(variance + self.bn.eps)
        fused = nn.Conv2d(
            self.conv.in_channels,
            self.conv.out_channels,
            cast(tuple[int, int], self.conv.kernel_size),
            cast(tuple[int, int], self.conv.stride),
            cast(tuple[int, int], self.conv.padding),
        )
        fused.weight.copy_(self.conv.weight * gain[:, None, None, None])
        cast(Tensor, fused.bias).copy_(self.bn.bias - mean * gain)
        self.conv, self.bn = fused.to(self.conv.weight.device), nn.Identity()


class Bottleneck(nn.Module):
    """Two 3x3 convolutions, with the input added where `shortcut` says so."""

    def __init__(self, channels: int, *, shortcut: bool) -> None:
        super().__init__()
        self.cv1 = Conv(channels, channels, 3)
        self.cv2 = Conv(channels, channels, 3)
        self._shortcut = shortcut

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c h w"]:
        """Filter one feature map."""
        y = self.cv2(self.cv1(x))
        return x + y if self._shortcut else y


class C2f(nn.Module):
    """Half of the channels runs through a chain of bottlenecks; every link's output is kept."""

    def __init__(self, inputs: int, outputs: int, repeats: int, *, shortcut: bool) -> None:
        super().__init__()
        hidden = outputs // 2
        self.cv1 = Conv(inputs, 2 * hidden)
        self.cv2 = Conv((2 + repeats) * hidden, outputs)
        self.m = nn.ModuleList(Bottleneck(hidden, shortcut=shortcut) for _ in range(repeats))

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h w"]:
        """Filter one feature map."""
        links = list(self.cv1(x).chunk(2, dim=1))
        for bottleneck in self.m:
            links.append(bottleneck(links[-1]))
        return self.cv2(torch.cat(links, dim=1))


class C2(nn.Module):
    """As C2f, but only the chain's last output is kept (necks of the four-level networks)."""

    def __init__(self, inputs: int, outputs: int, repeats: int, *, shortcut: bool) -> None:
        super().__init__()
        hidden = outputs // 2
        self.cv1 = Conv(inputs, 2 * hidden)
        self.cv2 = Conv(2 * hidden, outputs)
        self.m = nn.Sequential(*(Bottleneck(hidden, shortcut=shortcut) for _ in range(repeats)))

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h w"]:
        """Filter one feature map."""
        chained, kept = self.cv1(x).chunk(2, dim=1)
        return self.cv2(torch.cat([self.m(chained), kept], dim=1))


class SPPF(nn.Module):
    """Three chained 5x5 max pools: a spatial pyramid pooling at a fraction of the cost."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.cv1 = Conv(inputs, inputs // 2)
        self.cv2 = Conv(inputs * 2, outputs)

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b d h w"]:
        """Filter one feature map."""
        pools = [self.cv1(x)]
        for _ in range(3):
            pools.append(nn.functional.max_pool2d(pools[-1], 5, stride=1, padding=2))
        return self.cv2(torch.cat(pools, dim=1))


class Upsample(nn.Module):
    """Nearest neighbour, twice the size."""

    def forward(self, x: Float[Tensor, "b c h w"]) -> Float[Tensor, "b c i j"]:
        """Double one feature map."""
        return nn.functional.interpolate(x, scale_factor=2.0, mode="nearest")


class Concat(nn.Module):
    """Joins the last feature map with one from further up; a place in the layer list only."""

    def forward(self, maps: list[Tensor]) -> Float[Tensor, "b c h w"]:
        """Join along the channels."""
        return torch.cat(maps, dim=1)
