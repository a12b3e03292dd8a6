"""Renders training crops as one batch of tensors, on the CPU or a GPU: surfaces, light, shadows.

Simpler light than synth/shading.py gives (a crop has no room for it), but the same rasteriser, so
that hundreds of crops a second come out of one core. The plane behind is textured from a bank cut
out of synth's surface maps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from jaxtyping import Bool, Float32, Float64
from torch import Tensor
from torch.nn.functional import avg_pool2d, grid_sample, interpolate, pad

from asdfviz.synth.mesh_bank import MeshBank, Triangles
from asdfviz.synth.raster import Projected, corner_weights, depth_map, rasterize
from asdfviz.synth.shading import look_at
from asdfviz.synth.tensors import to_tensor, transform_each
from asdfviz.synth.textures import MACRO_KINDS, MICRO_KINDS, macro_map, micro_map
from asdfviz.train.crop_scenes import CropScene

TILES, TILE_PIXELS = 360, 128
"""The bank of textures."""
SHADOW_PIXELS = 64
FARTHEST = 4.0
"""Metres at which the plane ends."""
LIGHT_DISTANCE = 1.5
"""Metres from the part."""


@dataclass(frozen=True, slots=True, eq=False)
class RenderedCrops:
    """Crops before the camera's faults."""

    radiance: Float32[Tensor, "3 b h w"]
    """Linear RGB."""
    visible: Bool[Tensor, "b h w"]
    """Pixels that show the part."""
    silhouette: Bool[Tensor, "b h w"]
    """Pixels that would show it if it stood alone."""


def render_crops(
    scenes: Sequence[CropScene], bank: MeshBank, *, rng: np.random.Generator
) -> RenderedCrops:
    """Render crops, all of one size."""
    device = bank.vertices.device
    with torch.inference_mode():
        return _Batch(scenes, bank, rng, device).render()


class _Batch:
    """A batch of crops in the making. Vectors lie along the first axis: (3, b, h, w)."""

    def __init__(
        self,
        scenes: Sequence[CropScene],
        bank: MeshBank,
        rng: np.random.Generator,
        device: torch.device,
    ) -> None:
        self.scenes, self.rng, self.device = scenes, rng, device
        self.side = side = scenes[0].pixels
        self.shape = (len(scenes), side, side)
        owner = [i for i, scene in enumerate(scenes) for _ in scene.things]
        things = [thing for scene in scenes for thing in scene.things]
        self.triangles = bank.place(
            torch.tensor([t.mesh for t in things], dtype=torch.int64, device=device),
            to_tensor(np.stack([t.T_crop_mesh for t in things]), device),
            image=torch.tensor(owner, dtype=torch.int64, device=device),
        )
        self.colors = self._tensor([t.color for t in things]).T.contiguous()
        self.roughness = self._tensor(rng.uniform(0.3, 0.8, len(things)))
        counts = np.array([len(scene.things) for scene in scenes])
        self.first = to_tensor(np.cumsum(counts) - counts, device)
        self.focal = self._tensor([s.focal for s in scenes])[:, None, None]
        self.distance = self._tensor([s.T_crop_part[2, 3] for s in scenes])[:, None, None]
        self.normal = self._tensor(np.stack([s.normal for s in scenes], axis=1))[:, :, None, None]
        self.height = self._tensor([s.height for s in scenes])[:, None, None]
        place = torch.arange(side, device=device, dtype=torch.float32) - (side - 1) / 2
        x, y = place / self.focal, place[:, None] / self.focal
        ones = torch.ones(self.shape, device=device)
        self.rays = torch.stack([x.expand(self.shape), y.expand(self.shape), ones])

    def render(self) -> RenderedCrops:
        """Everything."""
        depth, albedo = self._plane()
        normal = self.normal.expand(3, *self.shape).contiguous()
        rough = torch.full(self.shape, 0.9, device=self.device)
        of_part = self.triangles.instance == self.first[self.triangles.image]
        projected = self._projected(self.triangles)
        fragments = rasterize(projected, self.shape)
        weights = corner_weights(projected, fragments, self.shape)
        near = fragments.depth < depth.view(-1)[fragments.covered]
        hit, face, weights = fragments.covered[near], fragments.face[near], weights[near]
        owner = self.triangles.instance[face]
        facing = self.triangles.normals_at(face, weights).T
        away = (facing * self.rays.view(3, -1)[:, hit]).sum(0) > 0
        depth.view(-1)[hit] = fragments.depth[near]
        normal.view(3, -1)[:, hit] = torch.where(away, -facing, facing)
        albedo.view(3, -1)[:, hit] = self.colors[:, owner] * self._mottled(len(hit))
        rough.view(-1)[hit] = self.roughness[owner]
        visible = torch.zeros(self.shape, dtype=torch.bool, device=self.device)
        visible.view(-1)[hit] = of_part[face]
        light = self._lit(depth, normal, albedo, rough)
        return RenderedCrops(light, visible, self._alone(projected, of_part))

    def _tensor(self, values: object) -> Tensor:
        return to_tensor(np.asarray(values, np.float32), self.device)

    def _uniform(self, low: float, high: float, *size: int) -> Tensor:
        return self._tensor(self.rng.uniform(low, high, size))

    def _each(self, low: float, high: float) -> Tensor:
        """A number for every crop."""
        return self._uniform(low, high, self.shape[0], 1, 1)

    def _projected(self, triangles: Triangles) -> Projected:
        p, image = triangles.vertices, triangles.vertex_image
        flat = p[:, :2] / p[:, 2:].clamp(min=1e-3) * self.focal[image, 0]
        return Projected(
            flat + (self.side - 1) / 2, p[:, 2].contiguous(), triangles.faces, triangles.image
        )

    def _alone(self, projected: Projected, of_part: Tensor) -> Tensor:
        part = Projected(
            projected.points_px, projected.depth, projected.faces[of_part], projected.image[of_part]
        )
        return depth_map(part, self.shape) < torch.inf

    def _mottled(self, count: int) -> Tensor:
        grain = self.rng.standard_normal(count, dtype=np.float32)
        return 1 + 0.04 * to_tensor(grain, self.device)

    def _plane(self) -> tuple[Tensor, Tensor]:
        """Depth and colour of the plane behind."""
        slope = (self.rays * self.normal).sum(0)
        reach = self.height / slope.clamp(max=-1e-3)
        depth = torch.where((reach > 0) & (slope < -1e-3), reach, FARTHEST).clamp(max=FARTHEST)
        points = self.rays * depth
        any_way = self._tensor(self.rng.normal(size=self.normal.shape))
        side = _unit(_across(self.normal, any_way))
        up = _across(self.normal, side)
        # A tile covers one to five widths of the view.
        size = self.side / self.focal * self.distance * self._each(1.0, 5.0)
        u = (points * side).sum(0) / size + self._each(-5.0, 5.0)
        v = (points * up).sum(0) / size + self._each(-5.0, 5.0)
        grid = torch.stack([u, v], dim=3)
        grid = ((grid / 2 - (grid / 2).floor()) * 2 - 1).abs() * 2 - 1  # mirrored repeats
        tiles = to_tensor(self.rng.integers(0, TILES, self.shape[0]), self.device)
        bank = texture_bank(str(self.device))[tiles].float() / 255
        maps = grid_sample(bank, grid, padding_mode="border", align_corners=False)
        w1, w2, shade = maps.transpose(0, 1)
        colors = self._tensor(_three_colors(self.rng, self.shape[0])).permute(1, 2, 0)
        first, second, third = colors[:, :, :, None, None]
        mixed = (first * (1 - w1) + second * w1) * (1 - w2) + third * w2
        return depth.contiguous(), (mixed * (shade * 2)).clamp(0.002, 0.95).contiguous()

    def _lit(
        self,
        depth: Float32[Tensor, "b h w"],
        normal: Float32[Tensor, "3 b h w"],
        albedo: Float32[Tensor, "3 b h w"],
        rough: Float32[Tensor, "b h w"],
    ) -> Float32[Tensor, "3 b h w"]:
        """Two lights, one of them with shadows, and light from all around."""
        position = self.rays * depth
        view = -_unit(self.rays)
        n_view = (normal * view).sum(0).clamp(0.06, 1)
        total = torch.zeros_like(albedo)
        for number in range(2):
            light = self._light_positions()
            strength = self._each(0.5, 1.5)
            if number:
                strength = strength * 0.7 * (self._each(0.0, 1.0) < 0.6)
            else:
                strength = strength * self._unshadowed(light, position, normal)
            tint = 1 + 0.1 * self._uniform(-1.0, 1.0, 3, self.shape[0], 1, 1)
            direction = _unit(light - position)
            cosine = (normal * direction).sum(0)
            gloss = _gloss(normal, direction + view, rough) / n_view * (cosine > 0)
            shine = albedo * (cosine.clamp(min=0) * strength) + gloss * strength
            total += shine * tint
        upward = 0.5 + 0.5 * (normal * self.normal).sum(0)
        rim = (0.04 + 0.3 * (1 - n_view) ** 5) * (1 - rough)
        around = self._each(0.2, 0.9) * (0.35 + 0.65 * upward) * _occlusion(depth, self.focal)
        return total + around * (albedo + rim)

    def _light_positions(self) -> Float32[Tensor, "3 b 1 1"]:
        """Above the plane, anywhere around."""
        towards = _unit(self._tensor(self.rng.normal(size=self.normal.shape)))
        towards = _unit(towards + self.normal * self._uniform(0.6, 1.6, 1, self.shape[0], 1, 1))
        middle = torch.cat([torch.zeros_like(towards[:2]), self.distance[None]])
        return middle + LIGHT_DISTANCE * towards

    def _unshadowed(self, light: Tensor, position: Tensor, normal: Tensor) -> Tensor:
        """Share of the first light that reaches each pixel, by one shadow map a crop."""
        rows: list[Float64[np.ndarray, "3 4"]] = []
        side = SHADOW_PIXELS
        for scene, eye in zip(self.scenes, light[:, :, 0, 0].T.double().cpu().numpy(), strict=True):
            middle = np.array([0.0, 0.0, scene.T_crop_part[2, 3]])
            reach = 0.75 * self.side / scene.focal * middle[2]
            focal = side / 2 * LIGHT_DISTANCE / reach
            rows.append(np.diag([focal, focal, 1.0]) @ look_at(eye, middle, roll=0.3)[:3])
        M = self._tensor(np.stack(rows))
        x, y, z = transform_each(M, self.triangles.vertices, self.triangles.vertex_image)
        flat = torch.stack([x, y], dim=1) / z.clamp(min=1e-3)[:, None] + side / 2
        cast = Projected(flat, z.contiguous(), self.triangles.faces, self.triangles.image)
        blocked = depth_map(cast, (len(self.scenes), side, side))
        lifted = position + normal * 0.002
        rows3 = M.permute(1, 2, 0)[:, :, :, None, None]
        q = [(row[:3] * lifted).sum(0) + row[3] for row in rows3]
        soft = self._each(0.3, 3.0)
        jitter = self._uniform(-1.0, 1.0, 2, 1, *self.shape[1:])
        grid = torch.stack([q[k] / q[2] + soft * jitter[k] + 0.5 for k in range(2)], dim=3)
        nearest = grid_sample(
            blocked.clamp(max=1e3)[:, None], grid / (side / 2), mode="nearest",
            padding_mode="border", align_corners=False,
        )[:, 0]  # fmt: skip
        lit = (q[2] < nearest + 0.0015).float()
        return avg_pool2d(lit[:, None], 3, stride=1, padding=1, count_include_pad=False)[:, 0]


def _across(a: Tensor, b: Tensor) -> Tensor:
    """Cross products of vectors along the first axis."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    return torch.stack([x, y, a[0] * b[1] - a[1] * b[0]])


def _unit(vectors: Tensor) -> Tensor:
    """Vectors along the first axis brought to length 1."""
    return vectors * (vectors * vectors).sum(0).rsqrt()


def _gloss(normal: Tensor, between: Tensor, rough: Tensor) -> Tensor:
    """The GGX lobe of a dielectric, without the division by the view's cosine."""
    n_half = (normal * between).sum(0).clamp(min=0).square() / (between * between).sum(0)
    alpha = rough.square().clamp(min=0.03).square()
    return 0.01 * alpha / (np.pi * (n_half * (alpha - 1) + 1).square())


def _occlusion(depth: Tensor, focal: Tensor) -> Tensor:
    """Darkness of places that lie deeper than their surroundings, at two sizes."""
    total = torch.ones_like(depth)
    small = avg_pool2d(depth[:, None], 2)
    for radius, strength in ((1, 0.6), (4, 0.35)):
        soft = pad(small, (radius,) * 4, mode="replicate")
        soft = avg_pool2d(soft, 2 * radius + 1, stride=1)
        soft = interpolate(soft, size=depth.shape[1:], mode="bilinear")[:, 0]
        # In units of the neighbourhood's own size, so that near and far views darken alike.
        sunk = (depth - soft) * focal / (depth * (2 * radius))
        total = total * torch.exp(-strength * sunk.clamp(0, 1.5))
    return total


def _three_colors(rng: np.random.Generator, count: int) -> Float32[np.ndarray, "b 3 3"]:
    """Colours of the plane's texture: any, half of the time related to one another."""
    value = rng.uniform(0.15, 0.9, (count, 3, 1))
    tinted = value * (1 - rng.beta(1.2, 2.5, (count, 3, 1)) * rng.random((count, 3, 3)))
    related = tinted[:, :1] * np.exp(rng.normal(size=(count, 3, 3)) * 0.25)
    mixed = np.where(rng.random((count, 1, 1)) < 0.5, related, tinted)
    return (np.clip(mixed, 0.01, 0.95) ** 2.2).astype(np.float32)


@cache
def texture_bank(device: str) -> Tensor:
    """Tiles (n, 3, side, side) of two mixing weights and half the brightness, 0 to 255."""
    rng = np.random.default_rng(73)
    tiles: list[Tensor] = []
    for number in range(TILES):
        if number % 3:
            kind = MACRO_KINDS[int(rng.integers(len(MACRO_KINDS)))]
            whole = macro_map(kind, int(rng.integers(2)), "cpu")
        else:
            whole = micro_map(MICRO_KINDS[int(rng.integers(len(MICRO_KINDS)))], 0, 0, "cpu")
        side = int(rng.integers(64, min(whole.shape[1], 400) + 1))
        y, x = (int(v) for v in rng.integers(0, whole.shape[1] - side + 1, 2))
        tile = whole[None, :3, y : y + side, x : x + side]
        tile = torch.nn.functional.interpolate(tile, size=(TILE_PIXELS,) * 2, mode="area")
        tile = tile * torch.tensor([1.0, 1.0, 0.5])[:, None, None]
        tiles.append((tile.clamp(0, 1) * 255).to(torch.uint8))
    return torch.cat(tiles).to(device)
