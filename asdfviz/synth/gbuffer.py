"""From scene descriptions to what lies behind each pixel: position, normal, colour, roughness, owner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64
from torch import Tensor
from torch.nn.functional import grid_sample, normalize

from asdfviz.geometry.camera import scaled_intrinsics
from asdfviz.synth.description import Ground, Scene
from asdfviz.synth.mesh_bank import MeshBank, Triangles
from asdfviz.synth.raster import Projected, corner_weights, rasterize
from asdfviz.synth.tensors import length, to_tensor
from asdfviz.synth.textures import (
    BLURS_PX,
    MACRO_SIZE,
    MICRO_PIXELS,
    MICRO_SIZE,
    macro_map,
    micro_map,
)

FAR = 12.0
"""Depth given to rays that hit nothing, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class GBuffer:
    """What each pixel sees; world frame, metres, linear RGB."""

    depth: Float32[Tensor, "b h w"]
    position: Float32[Tensor, "b h w 3"]
    normal: Float32[Tensor, "b h w 3"]
    view: Float32[Tensor, "b h w 3"]
    """Unit vector towards the camera."""
    albedo: Float32[Tensor, "b h w 3"]
    roughness: Float32[Tensor, "b h w"]
    translucency: Float32[Tensor, "b h w"]
    owner: Int64[Tensor, "b h w"]
    """Index of the placed mesh over the whole batch, -1 for the ground."""


@dataclass(frozen=True, slots=True, eq=False)
class Views:
    """The cameras of a batch, as tensors."""

    K: Float32[Tensor, "b 3 3"]
    R: Float32[Tensor, "b 3 3"]
    """R_camera_world."""
    t: Float32[Tensor, "b 3"]
    height: int
    width: int

    @classmethod
    def of(cls, scenes: Sequence[Scene], *, scale: float, device: str) -> Views:
        """The cameras of scenes of one image size, resampled by `scale`."""
        camera = scenes[0].camera
        height, width = round(camera.height * scale), round(camera.width * scale)
        Ks = [
            scaled_intrinsics(s.camera.K, width / camera.width, height / camera.height)
            for s in scenes
        ]
        Ts = np.stack([s.T_camera_world for s in scenes]).astype(np.float32)
        K = to_tensor(np.stack(Ks), device, dtype=torch.float32)
        T = to_tensor(Ts, device)
        return cls(K, T[:, :3, :3], T[:, :3, 3], height, width)

    def rays(self) -> Float32[Tensor, "b h w 3"]:
        """World directions of the pixels, of length 1 along the optical axis."""
        device = self.K.device
        v, u = torch.meshgrid(
            torch.arange(self.height, device=device, dtype=torch.float32),
            torch.arange(self.width, device=device, dtype=torch.float32),
            indexing="ij",
        )
        K = self.K[:, :, :, None, None]
        x, y = (u - K[:, 0, 2]) / K[:, 0, 0], (v - K[:, 1, 2]) / K[:, 1, 1]
        return torch.stack([x, y, torch.ones_like(x)], dim=-1) @ self.R[:, None]

    def centers(self) -> Float32[Tensor, "b 3"]:
        """Where the cameras are in the world."""
        return -(self.R.transpose(1, 2) @ self.t[:, :, None])[:, :, 0]

    def project(self, triangles: Triangles) -> Projected:
        """The triangles as each image's camera sees them."""
        index = triangles.vertex_image
        p = (self.R[index] @ triangles.vertices[:, :, None])[:, :, 0] + self.t[index]
        z = p[:, 2].clamp(min=1e-3)
        K = self.K[index]
        u = (K[:, 0, 0] * p[:, 0] + K[:, 0, 1] * p[:, 1]) / z + K[:, 0, 2]
        points_px = torch.stack([u, K[:, 1, 1] * p[:, 1] / z + K[:, 1, 2]], dim=1)
        return Projected(points_px, p[:, 2], triangles.faces, triangles.image)


def place_all(scenes: Sequence[Scene], bank: MeshBank) -> Triangles:
    """All placed meshes of all scenes as triangles; instances count over the whole batch."""
    device = bank.vertices.device
    placed = [(i, p) for i, scene in enumerate(scenes) for p in scene.placed]
    image = torch.tensor([i for i, _ in placed], dtype=torch.int64, device=device)
    mesh = torch.tensor([p.mesh for _, p in placed], dtype=torch.int64, device=device)
    T = np.stack([p.T_world_mesh for _, p in placed]) if placed else np.zeros((0, 4, 4))
    return bank.place(mesh, to_tensor(T, device), image=image)


def build_gbuffer(scenes: Sequence[Scene], triangles: Triangles, views: Views) -> GBuffer:
    """Rasterise the meshes, put the grounds behind them and look up all materials."""
    rays, centers = views.rays(), views.centers()
    buffer = _ground_buffer(scenes, rays, centers)
    _paint_meshes(scenes, triangles, views.project(triangles), buffer, rays)
    return buffer


def _ground_buffer(scenes: Sequence[Scene], rays: Tensor, centers: Tensor) -> GBuffer:
    count, height, width, _ = rays.shape
    depth = torch.full((count, height, width), FAR, device=rays.device)
    normal = torch.zeros_like(rays)
    albedo = torch.zeros_like(rays)
    roughness = torch.ones_like(depth)
    for i, scene in enumerate(scenes):
        for ground in reversed(scene.grounds):
            _lay(ground, rays[i], centers[i], depth[i], normal[i], albedo[i], roughness[i])
    missed = depth >= FAR
    normal[missed] = -normalize(rays[missed], dim=1)
    position = centers[:, None, None] + rays * depth[..., None]
    owner = torch.full_like(depth, -1, dtype=torch.int64)
    return GBuffer(
        depth,
        position,
        normal,
        -normalize(rays, dim=3),
        albedo,
        roughness,
        torch.zeros_like(depth),
        owner,
    )


def _lay(
    ground: Ground,
    rays: Float32[Tensor, "h w 3"],
    center: Float32[Tensor, "3"],
    depth: Float32[Tensor, "h w"],
    normal: Float32[Tensor, "h w 3"],
    albedo: Float32[Tensor, "h w 3"],
    roughness: Float32[Tensor, "h w"],
) -> None:
    """Write one ground over what lies behind it."""
    reach = (ground.height - center[2]) / torch.where(
        rays[:, :, 2].abs() < 1e-4, -1e-4, rays[:, :, 2]
    )
    x, y = center[0] + rays[:, :, 0] * reach, center[1] + rays[:, :, 1] * reach
    mask = ground_mask(ground, x, y) & (reach > 0) & (reach < FAR)
    if not bool(mask.any()):
        return
    x, y, reach = x[mask], y[mask], reach[mask]
    footprint = float(reach.mean()) * float(length(rays[0, 1] - rays[0, 0]))
    weights = _texels(ground, x, y, footprint)
    colors = to_tensor(ground.colors, rays.device, dtype=torch.float32)
    w1, w2 = weights[0, :, None], weights[1, :, None]
    color = (colors[0] * (1 - w1) + colors[1] * w1) * (1 - w2) + colors[2] * w2
    c, s = float(np.cos(ground.angle)), float(np.sin(ground.angle))
    slope_x = (c * weights[3] - s * weights[4]) * ground.bump
    slope_y = (s * weights[3] + c * weights[4]) * ground.bump
    normal[mask] = normalize(torch.stack([-slope_x, -slope_y, torch.ones_like(x)], dim=1), dim=1)
    albedo[mask] = (color * weights[2, :, None]).clamp(0.002, 0.95)
    depth[mask] = reach
    roughness[mask] = ground.roughness


def ground_mask(
    ground: Ground, x: Float32[Tensor, "h w"], y: Float32[Tensor, "h w"]
) -> Bool[Tensor, "h w"]:
    """Whether points (x, y) of a ground's plane belong to it."""
    mask = torch.ones_like(x, dtype=torch.bool)
    for a, b, c in ground.edges.tolist():
        mask &= a * x + b * y <= c
    if ground.circle is not None:
        cx, cy, radius = ground.circle
        mask &= (x - cx) ** 2 + (y - cy) ** 2 <= radius**2
    return mask


def _texels(
    ground: Ground, x: Float32[Tensor, "p"], y: Float32[Tensor, "p"], footprint: float
) -> Float32[Tensor, "5 p"]:
    """Both maps at points of the plane, combined."""
    c, s = float(np.cos(ground.angle)), float(np.sin(ground.angle))
    u = c * x + s * y + ground.offset[0]
    v = -s * x + c * y + ground.offset[1]
    device = str(x.device)
    size = MACRO_SIZE * ground.scale
    large = macro_map(*ground.macro, device)
    grid = torch.stack([u, v], dim=1)[None, None] * (2 / size)
    coarse = grid_sample(
        large[None], grid, mode="bilinear", padding_mode="reflection", align_corners=False
    )[0, :, 0]
    blur_px = 0.6 * footprint / (MICRO_SIZE / MICRO_PIXELS)
    level = int(np.searchsorted(BLURS_PX, blur_px * 0.75))
    small = micro_map(*ground.micro, min(level, len(BLURS_PX) - 1), device)
    wrapped = torch.stack([u, v], dim=1)[None, None] / MICRO_SIZE
    wrapped = (wrapped - wrapped.floor()) * 2 - 1
    # The repeating map is padded by one texel so that interpolation crosses its border smoothly.
    padded = torch.nn.functional.pad(small[None], (1, 1, 1, 1), mode="circular")
    wrapped = wrapped * (MICRO_PIXELS / (MICRO_PIXELS + 2))
    fine = grid_sample(padded, wrapped, mode="bilinear", align_corners=False)[0, :, 0]
    return torch.stack(
        [
            (coarse[0] + fine[0]).clamp(0, 1),
            (coarse[1] + fine[1]).clamp(0, 1),
            coarse[2] * fine[2],
            coarse[3] / ground.scale + fine[3],
            coarse[4] / ground.scale + fine[4],
        ]
    )


def _paint_meshes(
    scenes: Sequence[Scene],
    triangles: Triangles,
    projected: Projected,
    buffer: GBuffer,
    rays: Tensor,
) -> None:
    """Write the meshes' pixels over the grounds."""
    count, height, width = buffer.depth.shape
    shape = (count, height, width)
    fragments = rasterize(projected, shape)
    weights = corner_weights(projected, fragments, shape)
    in_front = fragments.depth < buffer.depth.view(-1)[fragments.covered]
    hit, depth = fragments.covered[in_front], fragments.depth[in_front]
    face, weights = fragments.face[in_front], weights[in_front]
    if len(hit) == 0:
        return
    owner = triangles.instance[face]
    finish = _finishes(scenes, rays.device)[owner]
    normal = normalize((triangles.normals[face] * weights[:, :, None]).sum(1), dim=1)
    local = (triangles.local[triangles.faces[face]] * weights[:, :, None]).sum(1)
    view = buffer.view.view(-1, 3)[hit]
    normal = torch.where((normal * view).sum(1, keepdim=True) < 0, -normal, normal)
    color, normal = _decorate(
        finish, local, normal, depth * float(length(rays[0, 0, 1] - rays[0, 0, 0]))
    )
    buffer.position.view(-1, 3)[hit] += (depth - buffer.depth.view(-1)[hit])[
        :, None
    ] * rays.reshape(-1, 3)[hit]
    buffer.depth.view(-1)[hit] = depth
    buffer.normal.view(-1, 3)[hit] = normal
    buffer.albedo.view(-1, 3)[hit] = color.clamp(0.002, 0.95)
    buffer.roughness.view(-1)[hit] = finish[:, 3]
    buffer.translucency.view(-1)[hit] = finish[:, 8]
    buffer.owner.view(-1)[hit] = owner


def _finishes(scenes: Sequence[Scene], device: torch.device) -> Float32[Tensor, "i 12"]:
    rows = [
        [
            *p.finish.color,
            p.finish.roughness,
            p.finish.mottling,
            p.finish.layer_axis,
            p.finish.layer_height,
            p.finish.layer_depth,
            p.finish.translucency,
            *p.T_world_mesh[:3, p.finish.layer_axis],
        ]
        for scene in scenes
        for p in scene.placed
    ]
    return torch.tensor(rows, dtype=torch.float32, device=device)


def _decorate(
    finish: Float32[Tensor, "p 12"],
    local: Float32[Tensor, "p 3"],
    normal: Float32[Tensor, "p 3"],
    footprint: Float32[Tensor, "p"],
) -> tuple[Float32[Tensor, "p 3"], Float32[Tensor, "p 3"]]:
    """Mottled colour and a normal tilted by printed layers where a pixel can resolve them."""
    noise = macro_map("noise", 0, str(local.device))[0]
    x = (local[:, 0] + 0.71 * local[:, 2]) * (noise.shape[0] / 0.25)
    y = (local[:, 1] + 0.53 * local[:, 2] - 0.31 * local[:, 0]) * (noise.shape[0] / 0.25)
    value = noise[y.long() % noise.shape[0], x.long() % noise.shape[1]]
    color = finish[:, :3] * (1 + (value - 0.5) * finish[:, 4])[:, None]
    along = local.gather(1, finish[:, 5:6].long())[:, 0]
    height = finish[:, 6]
    seen = (height / (2 * footprint) - 0.5).clamp(0, 1)
    tilt = torch.sin(along * (2 * np.pi) / height) * finish[:, 7] * seen
    return color, normalize(normal + finish[:, 9:12] * tilt[:, None], dim=1)
