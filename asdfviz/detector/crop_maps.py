"""The maps that networks of crops read: from pictures, and what is known of them, to features at two scales."""

from __future__ import annotations

from jaxtyping import Float, Int64
from torch import Tensor, nn
from torch.nn.functional import interpolate, silu

from asdfviz.detector.blocks import Bottleneck, Conv

MAPS = (
    "quarter", "know_quarter", "eighth", "know_eighth", "sixteenth", "know_sixteenth", "lift",
)  # fmt: skip
"""Modules of `CropMaps`, which one network may take over from another."""


class Film(nn.Module):
    """Scales and shifts channels by what is known of a part class."""

    def __init__(self, classes: int, channels: int) -> None:
        super().__init__()
        self.table = nn.Embedding(classes, 2 * channels)
        nn.init.normal_(self.table.weight, 0, 0.02)

    def forward(self, x: Float[Tensor, "b c h w"], part: Int64[Tensor, "b"]) -> Tensor:
        """Modulate a feature map."""
        gain, shift = self.table(part)[:, :, None, None].chunk(2, dim=1)
        return x * (1 + gain) + shift


class CropMaps(nn.Module):
    """What networks of crops have in common."""

    def __init__(self, classes: int, widths: tuple[int, ...]) -> None:
        """Build it with random weights.

        Args:
            classes: that crops may be of.
            widths: channels at strides 2, 4, 8 and 16.
        """
        super().__init__()
        a, b, c, d = widths
        self.quarter = nn.Sequential(
            Conv(3, a, 3, stride=2), Conv(a, b, 3, stride=2), Bottleneck(b, shortcut=True)
        )
        self.know_quarter = Film(classes, b)
        self.eighth = nn.Sequential(
            Conv(b, c, 3, stride=2), Bottleneck(c, shortcut=True), Bottleneck(c, shortcut=True)
        )
        self.know_eighth = Film(classes, c)
        self.sixteenth = nn.Sequential(Conv(c, d, 3, stride=2), Bottleneck(d, shortcut=True))
        self.know_sixteenth = Film(classes, d)
        self.lift = nn.ModuleList([nn.Conv2d(d, b, 1), nn.Conv2d(c, b, 1), nn.Conv2d(b, b, 1)])

    def maps(
        self, crops: Float[Tensor, "b 3 h w"], known: Int64[Tensor, "b"]
    ) -> tuple[Float[Tensor, "b c i j"], Float[Tensor, "b d k l"]]:
        """Features at stride 4, which know what is around, and those at stride 16."""
        quarter = self.know_quarter(self.quarter(crops), known)
        eighth = self.know_eighth(self.eighth(quarter), known)
        sixteenth = self.know_sixteenth(self.sixteenth(eighth), known)
        small, middle, large = self.lift
        up = middle(eighth) + _doubled(small(sixteenth))
        return silu(large(quarter) + _doubled(up)), sixteenth


def _doubled(x: Tensor) -> Tensor:
    return interpolate(x, scale_factor=2.0, mode="nearest")
