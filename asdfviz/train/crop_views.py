"""From stored crops to what the network is shown: any roll, boxes as a detector gives them, and targets.

A roll and a shift of the box turn the crop's camera about its centre, so picture and pose change
exactly: one stored crop gives a new rotation every time that it is shown.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Int64
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample

from asdfviz.detector.crop_classes import CropClass, group_states, state_spans
from asdfviz.detector.crop_cut import CONTEXT, CROP_PIXELS
from asdfviz.detector.crop_network import STRIDE
from asdfviz.detector.view_rotations import about_z, towards
from asdfviz.geometry.rotation_grid import Quaternions, even_rotations
from asdfviz.synth.tensors import to_tensor
from asdfviz.train.crop_data import Crops

SOFTNESS = 0.22
"""Radians by which the target distribution spreads about the true rotation."""
SHIFT, ZOOM = 0.07, 0.14
"""Deviation of a detected box: of its middle as a share of its side, of the log of its size."""
UNKNOWN, ASTRAY = 0.12, 0.15
"""Share of boxes in which depth was not measured, and of those where it belongs to something else,"""
NEAR_BY, FAR_BY = 0.03, 0.15
"""and deviation of the log of the others' measured distances, and of theirs."""


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """A training batch."""

    pictures: Float32[Tensor, "b 3 s s"]
    """RGB, -0.5 to 0.5."""
    labels: Int64[Tensor, "b"]
    states: Int64[Tensor, "b"]
    """As `Crops.states`."""
    names: Int64[Tensor, "b"]
    """As `Crops.names`."""
    quaternions: Float32[Tensor, "b 4"]
    """True R_crop_part."""
    place: Float32[Tensor, "b 3"]
    """As `CropOutput.place`."""
    outline: Float32[Tensor, "b i j"]
    """Share of each cell that shows the part; NaN where that is not known."""
    sizes: Float32[Tensor, "b"]
    """As `CropNetwork.names` takes them."""


class ViewMaker:
    """Cuts views of stored crops and knows the targets of every class."""

    def __init__(
        self,
        classes: Sequence[CropClass],
        *,
        grid: int,
        device: str = "cpu",
    ) -> None:
        self.device = device
        self.nothing = len(classes)
        """The name of what is no class."""
        corners = [c.corners for c in classes]
        most = max(len(c) for c in corners)
        padded = np.stack([c[np.arange(most) % len(c)] for c in corners])
        self._corners = to_tensor(padded.astype(np.float32), device)
        middles = np.stack([c.middle for c in classes]).astype(np.float32)
        self._middles = to_tensor(middles, device)
        self._diameters = torch.tensor(
            [c.diameter for c in classes], dtype=torch.float32, device=device
        )
        self._grid = to_tensor(even_rotations(grid).astype(np.float32), device)
        self._first, self._second = _spans(classes, device)
        own = torch.zeros(len(classes), sum(len(c.states) for c in classes), dtype=torch.bool)
        spans = state_spans(group_states(classes))
        for label, crop_class in enumerate(classes):
            own[label, spans.get(crop_class.name, slice(0))] = True
        self._own_states = own.to(device)

    def views(self, crops: Crops, *, rng: np.random.Generator, jitter: float = 1.0) -> Views:
        """Show crops with any roll.

        Args:
            crops: on this device.
            rng: rolls, boxes and tones.
            jitter: factor on the errors of the boxes; 0 shows true boxes without any roll.
        """
        count = len(crops)

        def normal(*size: int) -> Tensor:
            values = rng.normal(size=(count, *size)).astype(np.float32)
            return jitter * to_tensor(values, self.device)

        turn = rng.uniform(-np.pi, np.pi, count) * (jitter > 0)
        R_stored_rolled = about_z(to_tensor(turn.astype(np.float32), self.device))
        middle, side = self._boxes(crops, R_stored_rolled)
        middle = middle + SHIFT * normal(2).clamp(-2, 2) * side[:, None]
        side = side * torch.exp(ZOOM * normal().clamp(-2, 2))
        R_stored_view = R_stored_rolled @ towards(middle)
        focal = CROP_PIXELS / (CONTEXT * side)
        T = crops.T_crop_part
        R_view_part = R_stored_view.transpose(1, 2) @ T[:, :3, :3]
        t = (R_stored_view.transpose(1, 2) @ T[:, :3, 3:])[:, :, 0]
        shown = cut_views(crops, R_stored_view, focal, size=(CROP_PIXELS, CROP_PIXELS))
        rgb, seen = shown[:, :3], shown[:, 3:]
        if jitter > 0:
            rgb = toned(rgb, rng)
        return Views(
            rgb - 0.5,
            crops.labels,
            crops.states,
            crops.names,
            _quaternions(R_view_part),
            self._places(R_view_part, t, focal, crops.labels),
            torch.where(crops.outlined[:, None, None], avg_pool2d(seen, STRIDE)[:, 0], torch.nan),
            self._sizes(side, self._middle(R_view_part, t, crops.labels)[:, 2], rng, jitter),
        )

    def targets(
        self, quaternions: Float32[Tensor, "b 4"], labels: Int64[Tensor, "b"]
    ) -> Float32[Tensor, "b g"]:
        """The distribution over the grid that the network is taught: symmetric poses share equally."""
        return torch.softmax(-((self.angles(quaternions, labels) / SOFTNESS) ** 2), dim=1)

    def angles(
        self, quaternions: Float32[Tensor, "b 4"], labels: Int64[Tensor, "b"]
    ) -> Float32[Tensor, "b g"]:
        """Angle of every grid rotation to the nearest equivalent of the true one, radians."""
        total: Tensor | None = None
        for table in (self._first, self._second):
            equivalents = _product(quaternions[:, None], table[labels])
            squared = (equivalents @ self._grid.T).square()
            total = squared if total is None else total + squared
        assert total is not None
        return 2 * torch.arccos(total.amax(1).clamp(max=1).sqrt().clamp(max=1 - 1e-7))

    def own_states(
        self, logits: Float32[Tensor, "b t"], labels: Int64[Tensor, "b"]
    ) -> Float32[Tensor, "b t"]:
        """Logits of states, minus infinity for those of other groups."""
        return logits.masked_fill(~self._own_states[labels], -torch.inf)

    def _boxes(self, crops: Crops, R_stored_rolled: Tensor) -> tuple[Tensor, Tensor]:
        """Middle and longer side of the true box in the rolled view, at depth 1."""
        T = crops.T_crop_part
        R = R_stored_rolled.transpose(1, 2) @ T[:, :3, :3]
        t = R_stored_rolled.transpose(1, 2) @ T[:, :3, 3:]
        points = R @ self._corners[crops.labels].transpose(1, 2) + t
        flat = points[:, :2] / points[:, 2:].clamp(min=1e-3)
        low, high = flat.amin(2), flat.amax(2)
        return (low + high) / 2, (high - low).amax(1)

    def _places(self, R: Tensor, t: Tensor, focal: Tensor, labels: Tensor) -> Tensor:
        middle = self._middle(R, t, labels)
        offset = middle[:, :2] / middle[:, 2:] * (focal / (CROP_PIXELS / 2))[:, None]
        size = focal * self._diameters[labels] / (middle[:, 2] * CROP_PIXELS)
        return torch.cat([offset, size.log()[:, None]], dim=1)

    def _middle(self, R: Tensor, t: Tensor, labels: Tensor) -> Tensor:
        """Of the parts, in the view."""
        return (R @ self._middles[labels][:, :, None])[:, :, 0] + t

    def _sizes(
        self, side: Tensor, distance: Tensor, rng: np.random.Generator, jitter: float
    ) -> Float32[Tensor, "b"]:
        """Boxes' longer sides (given at depth 1) at the distances that depth measures in them."""
        noise = measured_sizes(rng, len(side)) if jitter > 0 else np.ones(len(side), np.float32)
        return side * distance * to_tensor(noise, self.device)


def toned(rgb: Float32[Tensor, "b 3 h w"], rng: np.random.Generator) -> Float32[Tensor, "b 3 h w"]:
    """Other brightness, contrast and tint; now and then grey."""
    count, device = len(rgb), rgb.device

    def each(low: float, high: float, channels: int = 1) -> Tensor:
        values = rng.uniform(low, high, (count, channels, 1, 1)).astype(np.float32)
        return to_tensor(values, device)

    rgb = rgb * each(0.75, 1.3) * each(0.92, 1.08, 3) + each(-0.08, 0.08)
    gray = rgb.mean(1, keepdim=True)
    keep = torch.where(each(0.0, 1.0) < 0.08, torch.zeros_like(gray[:, :, :1, :1]), each(0.6, 1.3))
    noise = to_tensor(rng.standard_normal(rgb.shape, dtype=np.float32), device)
    return (gray + (rgb - gray) * keep + noise * each(0.0, 0.02)).clamp(0, 1)


def measured_sizes(rng: np.random.Generator, count: int) -> Float32[np.ndarray, "n"]:
    """Measured over true distances of what is in boxes, as depth gives them; NaN where unknown."""
    astray = rng.random(count) < ASTRAY
    factors = np.exp(rng.normal(size=count) * np.where(astray, FAR_BY, NEAR_BY))
    factors[rng.random(count) < UNKNOWN] = np.nan
    return factors.astype(np.float32)


def _spans(classes: Sequence[CropClass], device: str) -> tuple[Tensor, Tensor]:
    """Quaternions whose products with a rotation span its equivalents, padded by repeats."""
    firsts: list[Quaternions] = []
    seconds: list[Quaternions] = []
    for crop_class in classes:
        first, second = crop_class.equivalents.spanning(np.array([0.0, 0.0, 0.0, 1.0]))
        firsts.append(first)
        seconds.append(second)
    most = max(len(f) for f in firsts)

    def padded(rows: list[Quaternions]) -> Tensor:
        table = np.stack([r[np.arange(most) % len(r)] for r in rows])
        return to_tensor(table.astype(np.float32), device)

    return padded(firsts), padded(seconds)


def cut_views(
    crops: Crops,
    R_stored_view: Float32[Tensor, "b 3 3"],
    focal: Float32[Tensor, "b"],
    *,
    size: tuple[int, int],
) -> Float32[Tensor, "b 4 h w"]:
    """Resample the stored pictures, 0 to 1; beyond their border the last pixels go on.

    Args:
        crops: stored.
        R_stored_view: of every view; both cameras have the same centre.
        focal: of the views, pixels.
        size: width and height of the views, pixels.
    """
    device, stored = crops.pictures.device, crops.pictures.shape[3]
    across, down = (torch.arange(n, device=device, dtype=torch.float32) - (n - 1) / 2 for n in size)
    y, x = torch.meshgrid(down, across, indexing="ij")
    flat = torch.stack([x.reshape(-1), y.reshape(-1)])
    # One ray in twelve columns would do for the eye; all of them keep the outline exact.
    ones = torch.ones(len(focal), 1, flat.shape[1], device=device)
    seen = R_stored_view @ torch.cat([flat[None] / focal[:, None, None], ones], dim=1)
    grid = seen[:, :2] / seen[:, 2:] * (crops.focal / (stored / 2))[:, None, None]
    grid = grid.transpose(1, 2).view(len(focal), size[1], size[0], 2)
    pictures = crops.pictures.float() / 255
    return grid_sample(pictures, grid, padding_mode="border", align_corners=False)


def _quaternions(R: Float32[Tensor, "b 3 3"]) -> Float32[Tensor, "b 4"]:
    """Unit quaternions (x, y, z, w): of four algebraically equal forms the best conditioned one."""
    m = R.flatten(1)
    d0, d1, d2 = m[:, 0], m[:, 4], m[:, 8]
    x, y, z = m[:, 7] - m[:, 5], m[:, 2] - m[:, 6], m[:, 3] - m[:, 1]
    xy, xz, yz = m[:, 1] + m[:, 3], m[:, 2] + m[:, 6], m[:, 5] + m[:, 7]
    forms = torch.stack(
        [
            torch.stack([1 + d0 - d1 - d2, xy, xz, x], dim=1),
            torch.stack([xy, 1 - d0 + d1 - d2, yz, y], dim=1),
            torch.stack([xz, yz, 1 - d0 - d1 + d2, z], dim=1),
            torch.stack([x, y, z, 1 + d0 + d1 + d2], dim=1),
        ],
        dim=1,
    )
    best = torch.diagonal(forms, dim1=1, dim2=2).argmax(1)
    chosen = forms[torch.arange(len(R), device=R.device), best]
    return chosen / (chosen * chosen).sum(1, keepdim=True).sqrt()


def _product(a: Float32[Tensor, "*r 4"], b: Float32[Tensor, "*s 4"]) -> Tensor:
    """Quaternion products along the last axis; the other axes are broadcast."""
    ax, ay, az, aw = (a[..., i] for i in range(4))
    bx, by, bz, bw = (b[..., i] for i in range(4))
    return torch.stack(
        [
            aw * bx + bw * ax + ay * bz - az * by,
            aw * by + bw * ay + az * bx - ax * bz,
            aw * bz + bw * az + ax * by - ay * bx,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        dim=-1,
    )
