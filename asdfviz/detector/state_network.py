"""The state network: from a crop about the base part, and how that part lies in it, to the assembly's state.

What is joined to a base part whose pose is known stands at known places of the picture. So the network
does not search: it reads its maps at the places where points of the joined parts would be seen, each
point always in the same place of what it reads, and tells from these which parts are there. The maps
are made as `CropNetwork` makes them and begin with its weights.
"""

from __future__ import annotations

import torch
from jaxtyping import Float, Float32, Int64
from torch import Tensor, nn
from torch.nn.functional import grid_sample, silu

from asdfviz.detector.crop_maps import CropMaps
from asdfviz.detector.state_cut import BasePoses

OWN = 10
"""Numbers that are kept of what is read at a point."""
GEOMETRY = ("points", "normals", "axes")
"""Buffers that hold what the groups are like, not what was learned."""
_POSE = 9


class StateNetwork(CropMaps):
    """About 2.8 million parameters with the default sizes, four groups and 160 points each."""

    points: Tensor
    normals: Tensor
    axes: Tensor

    def __init__(
        self,
        *,
        points: Float32[Tensor, "g p 3"],
        normals: Float32[Tensor, "g p 3"],
        axes: Float32[Tensor, "g 3"],
        states: int,
        widths: tuple[int, ...] = (24, 48, 96, 160),
        hidden: int = 192,
    ) -> None:
        """Build it with random weights.

        Args:
            points: of every group, on the parts in their places, base part's frame, metres.
            normals: outward, likewise.
            axes: `long_axis` of every group.
            states: of all groups together.
            widths: channels at strides 2, 4, 8 and 16.
            hidden: features from which states are told.
        """
        groups, count = points.shape[:2]
        super().__init__(groups, widths)
        self.groups, self.states = groups, states
        self.shape: dict[str, object] = {
            "groups": groups,
            "points": count,
            "states": states,
            "widths": list(widths),
            "hidden": hidden,
        }
        self.register_buffer("points", points)
        self.register_buffer("normals", normals)
        self.register_buffer("axes", axes)
        _, b, _, d = widths
        self.own = nn.Parameter(torch.randn(groups, count, b + 2, OWN) * (b + 2) ** -0.5)
        self.own_shift = nn.Parameter(torch.zeros(groups, count, OWN))
        self.pose = nn.Sequential(nn.Linear(_POSE, 64), nn.SiLU(), nn.Linear(64, count))
        self.drop = nn.Dropout(0.1)
        self.gather = nn.Parameter(
            torch.randn(groups, count * OWN + d + _POSE, hidden) * (count * OWN) ** -0.5
        )
        self.gather_shift = nn.Parameter(torch.zeros(groups, hidden))
        self.mix = nn.Linear(hidden, hidden)
        self.to_states = nn.Linear(hidden, states)

    def forward(
        self,
        crops: Float[Tensor, "b 3 h w"],
        group: Int64[Tensor, "b"],
        poses: BasePoses,
        focal: Float[Tensor, "b"],
    ) -> Float[Tensor, "b t"]:
        """Logits of the states of all groups, of which a crop's own count.

        Args:
            crops: RGB, -0.5 to 0.5; multiples of 16 high and wide, `STATE_SIZE` by default.
            group: of every crop.
            poses: of the base part in its camera.
            focal: of that camera, pixels; the crop's middle is its principal point.
        """
        maps, sixteenth = self.maps(crops, group)
        half = focal.new_tensor((crops.shape[3] / 2, crops.shape[2] / 2))
        read, facing = self._read(maps, group, poses, focal[:, None] / half)
        # How a point is turned, and what may hide it from there, weighs what is read at it.
        R = poses.R.flatten(1)
        weight = torch.sigmoid(self.pose(R) + 2 * facing)
        kept = torch.einsum("bpc,bpco->bpo", read, self.own[group]) + self.own_shift[group]
        seen = (silu(kept) * weight[:, :, None]).flatten(1)
        features = torch.cat([seen, sixteenth.mean((2, 3)), R], dim=1)
        gathered = torch.einsum("bf,bfh->bh", self.drop(features), self.gather[group])
        hidden = silu(gathered + self.gather_shift[group])
        return self.to_states(hidden + silu(self.mix(hidden)))

    def _read(
        self,
        maps: Float[Tensor, "b c i j"],
        group: Tensor,
        poses: BasePoses,
        scale: Float[Tensor, "b 2"],
    ) -> tuple[Float[Tensor, "b p e"], Float[Tensor, "b p"]]:
        """The maps at every point, whether it is in view and faces the camera; and how much it does."""
        # Sums, not matrix products: those would be rounded to bfloat16 where the maps are.
        R = poses.R[:, None]
        seen = (R * self.points[group][:, :, None]).sum(3) + poses.t[:, None]
        normals = (R * self.normals[group][:, :, None]).sum(3)
        depth = seen[:, :, 2:].clamp(min=1e-3)
        grid = seen[:, :, :2] / depth * scale[:, None]
        distance = (seen * seen).sum(2).sqrt()
        facing = -(normals * seen).sum(2) / distance.clamp(min=1e-3)
        found = grid_sample(maps.float(), grid[:, None], align_corners=False)
        extra = torch.stack([(grid.abs().amax(2) < 1).float(), facing], dim=2)
        return torch.cat([found[:, :, 0].transpose(1, 2), extra], dim=2), facing
