"""A small network that looks at one part, or one joined group, in a crop.

Of a part it tells rotation, place and visible outline; of a group those of its base part, and the
state. Asked of something unknown, it tells which part that is, if any; how large the
thing is, where depth tells that, is part of the question, for a near pin and a far rod look alike.

The rotation is a distribution over an even grid (geometry/rotation_grid.py), because parts without
texture often look alike from several sides, and a mean of two good answers is a bad one. Which
part it is comes in as a number: it scales and shifts feature maps (FiLM), and every part class has
a small layer of its own before the grid that all share.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from asdfviz.detector.blocks import Bottleneck, Conv
from asdfviz.detector.crop_maps import CropMaps

GRID = 2304
"""Rotations, about 17 degrees apart."""
STRIDE = 4
"""Of the outline against the crop."""
NAME_WIDTHS = (64, 112, 160, 128)
"""Channels at strides 8, 16 and 32 where the class is asked for, and features of the whole crop."""
SIZES = torch.logspace(math.log10(0.006), math.log10(0.4), 16)
"""Metres about which the branch that names parts tells sizes apart."""


@dataclass(frozen=True, slots=True, eq=False)
class CropOutput:
    """What the network says of a batch of crops."""

    rotations: Float[Tensor, "b g"]
    """Logits of the grid's rotations R_crop_part."""
    place: Float[Tensor, "b 3"]
    """Offset of the part's middle from the crop's centre over half the side (x, y), and the log of
    the crop's focal length times diameter over depth times side."""
    outline: Float[Tensor, "b i j"]
    """Logits that the part is visible, at a quarter of the resolution."""
    states: Float[Tensor, "b t"]
    """Logits of the states of all groups, one group's after another's: only its own ones tell of a
    crop. None where the network knows no groups (t = 0)."""


class NameBranch(nn.Module):
    """From a crop of which at most the size is known to the class; it shares nothing with the rest."""

    def __init__(self, widths: tuple[int, int], classes: int) -> None:
        super().__init__()
        a, b, c, hidden = NAME_WIDTHS
        half, quarter = widths
        self.maps = nn.Sequential(
            Conv(3, half, 3, stride=2),
            Conv(half, quarter, 3, stride=2),
            Bottleneck(quarter, shortcut=True),
            Conv(quarter, a, 3, stride=2),
            Bottleneck(a, shortcut=True),
            Conv(a, b, 3, stride=2),
            Bottleneck(b, shortcut=True),
            Conv(b, c, 3, stride=2),
        )
        self.features = nn.Linear(9 * c, hidden)
        self.know_size = nn.Linear(len(SIZES) + 1, 2 * hidden)
        nn.init.zeros_(self.know_size.weight)
        nn.init.zeros_(self.know_size.bias)
        self.to_names = nn.Linear(hidden, classes)

    def forward(
        self, crops: Float[Tensor, "b 3 s s"], sizes: Float[Tensor, "b"]
    ) -> Float[Tensor, "b n"]:
        """Logits of every class; `sizes` as in `CropNetwork.names`."""
        gain, shift = self.know_size(_spread(sizes)).chunk(2, dim=1)
        features = self.features(self.maps(crops).flatten(1)) * (1 + gain) + shift
        return self.to_names(nn.functional.silu(features))


class CropNetwork(CropMaps):
    """About 3 million parameters and 0.1 GMAC a crop with the default widths."""

    def __init__(
        self,
        *,
        classes: int,
        grid: int = GRID,
        widths: tuple[int, ...] = (24, 48, 96, 160, 224),
        hidden: int = 256,
        own: int = 128,
        states: int = 0,
        names: bool = False,
    ) -> None:
        """Build it with random weights.

        Args:
            classes: of parts and groups.
            grid: rotations.
            widths: channels at strides 2, 4, 8, 16 and 32.
            hidden: features of the whole crop.
            own: features after each class's own layer.
            states: of all groups together.
            names: whether it tells which part something is.
        """
        super().__init__(classes, widths[:4])
        self.classes, self.grid, self.own, self.states = classes, grid, own, states
        self.shape: dict[str, object] = {
            "classes": classes,
            "grid": grid,
            "widths": list(widths),
            "hidden": hidden,
            "own": own,
            "states": states,
            "names": names,
        }
        a, b, _, d, e = widths
        self.last = Conv(d, e, 3, stride=2)
        self.features = nn.Linear(9 * e, hidden)
        self.own_layer = nn.Linear(hidden, classes * own)
        self.to_grid = nn.Linear(own, grid)
        self.to_place = nn.Linear(own, 3)
        self.to_states = nn.Linear(own, states) if states else None
        self.name = NameBranch((a, b), classes + 1) if names else None
        self.draw = nn.Sequential(Conv(b, b // 2, 3), nn.Conv2d(b // 2, 1, 1))

    @property
    def tells_names(self) -> bool:
        """Whether it was built to tell which part something is."""
        return self.name is not None

    def forward(self, crops: Float[Tensor, "b 3 s s"], part: Int64[Tensor, "b"]) -> CropOutput:
        """Look at crops (RGB, -0.5 to 0.5; a multiple of 32 on a side, 96 by default) of parts."""
        fine, sixteenth = self.maps(crops, part)
        last = self.last(sixteenth)
        features = nn.functional.silu(self.features(last.flatten(1)))
        everyone = self.own_layer(features).view(len(part), self.classes, self.own)
        mine = nn.functional.silu(everyone[torch.arange(len(part), device=part.device), part])
        outline = self.draw(fine)[:, 0]
        none = mine[:, :0]
        states = none if self.to_states is None else self.to_states(mine)
        return CropOutput(self.to_grid(mine), self.to_place(mine), outline, states)

    def names(
        self, crops: Float[Tensor, "b 3 s s"], sizes: Float[Tensor, "b"]
    ) -> Float[Tensor, "b n"]:
        """Logits of what crops show: every class, then nothing that is known.

        Args:
            crops: RGB, -0.5 to 0.5.
            sizes: longer side of the box that was cut out, at the distance of what is in it, metres;
                NaN where no distance is known.

        Returns:
            None (n = 0) where the network was not taught this.
        """
        return crops.new_zeros(len(crops), 0) if self.name is None else self.name(crops, sizes)


def _spread(sizes: Float[Tensor, "b"]) -> Float[Tensor, "b k"]:
    """Sizes as bumps over the logarithms of `SIZES`, and whether they are known."""
    centers = SIZES.to(sizes.device).log()
    known = sizes.isfinite()[:, None]
    logs = torch.where(known, sizes[:, None], 1.0).log()
    bumps = torch.exp(-(((logs - centers) / (centers[1] - centers[0])) ** 2))
    return torch.cat([torch.where(known, bumps, 0.0), known.to(bumps.dtype)], dim=1)
