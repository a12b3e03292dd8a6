"""From scene descriptions to what lies behind each pixel: position, normal, colour, roughness, owner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Int64
from torch import Tensor

from asdfviz.geometry.camera import scaled_intrinsics
from asdfviz.synth.description import Scene
from asdfviz.synth.grounds import ground_depth, ground_looks
from asdfviz.synth.mesh_bank import MeshBank, Triangles
from asdfviz.synth.raster import Fragments, Projected, corner_weights, rasterize
from asdfviz.synth.surfaces import decorate
from asdfviz.synth.tensors import box_mean, dot, length, to_tensor, transform_each, unit

EDGE_RADIUS = 0.00045
"""How far, in metres, edges of meshes are worn round."""
MOST_WORN_PX = 3


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
        Rt = torch.cat([self.R, self.t[:, :, None]], dim=2)
        index = triangles.vertex_image
        x, y, z = transform_each(self.K @ Rt, triangles.vertices, index)
        safe = z.clamp(min=1e-3)
        return Projected(
            torch.stack([x / safe, y / safe], dim=1), z, triangles.faces, triangles.image
        )


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
    depth, ground = ground_depth(scenes, rays, centers)
    projected = views.project(triangles)
    fragments, owner = _nearest(triangles, projected, depth)
    weights = corner_weights(projected, fragments, (len(scenes), views.height, views.width))
    view = -unit(rays)
    buffer = GBuffer(
        depth,
        centers[:, None, None] + rays * depth[..., None],
        view.clone(),
        view,
        torch.zeros_like(rays),
        torch.ones_like(depth),
        torch.zeros_like(depth),
        owner,
    )
    _paint_grounds(scenes, torch.where(owner < 0, ground, -1), buffer, rays)
    # Of the distance to the scene's middle, so that a fixed camera always wears edges alike.
    pixel = float(length(centers[0])) * float(length(rays[0, 0, 1] - rays[0, 0, 0]))
    worn_px = min(round(EDGE_RADIUS / max(pixel, 1e-5)), MOST_WORN_PX)
    _paint_meshes(scenes, triangles, fragments, weights, buffer, rays, worn_px=worn_px)
    return buffer


def exact_depth(
    scenes: Sequence[Scene], triangles: Triangles, views: Views, projected: Projected
) -> tuple[Float32[Tensor, "b h w"], Int64[Tensor, "b h w"]]:
    """Depth and owner (see GBuffer) without any looks; `projected` are the triangles in the views."""
    depth, _ = ground_depth(scenes, views.rays(), views.centers())
    return depth, _nearest(triangles, projected, depth)[1]


def _nearest(
    triangles: Triangles, projected: Projected, depth: Float32[Tensor, "b h w"]
) -> tuple[Fragments, Int64[Tensor, "b h w"]]:
    """What of the meshes lies before the grounds; writes its depth into `depth`."""
    count, height, width = depth.shape
    owner = torch.full_like(depth, -1, dtype=torch.int64)
    found = rasterize(projected, (count, height, width))
    in_front = (found.depth < depth.view(-1)[found.covered]).nonzero()[:, 0]
    seen = Fragments(found.depth[in_front], found.face[in_front], found.covered[in_front])
    depth.view(-1)[seen.covered] = seen.depth
    owner.view(-1)[seen.covered] = triangles.instance[seen.face]
    return seen, owner


def _paint_grounds(
    scenes: Sequence[Scene], which: Int64[Tensor, "b h w"], buffer: GBuffer, rays: Tensor
) -> None:
    """Write the looks of the grounds where they are seen."""
    pixels = which.shape[1] * which.shape[2]
    for i, scene in enumerate(scenes):
        for k, ground in enumerate(scene.grounds):
            place = (which[i].view(-1) == k).nonzero()[:, 0] + i * pixels
            if len(place) == 0:
                continue
            x, y = (buffer.position.view(-1, 3)[place, axis] for axis in (0, 1))
            pixel = float(length(rays[i, 0, 1] - rays[i, 0, 0]))
            footprint = float(buffer.depth.view(-1)[place].mean()) * pixel
            albedo, normal = ground_looks(ground, x, y, footprint)
            buffer.normal.view(-1, 3)[place] = normal
            buffer.albedo.view(-1, 3)[place] = albedo
            buffer.roughness.view(-1)[place] = ground.roughness


def _paint_meshes(
    scenes: Sequence[Scene],
    triangles: Triangles,
    fragments: Fragments,
    weights: Float32[Tensor, "p 3"],
    buffer: GBuffer,
    rays: Tensor,
    *,
    worn_px: int,
) -> None:
    """Write the looks of the meshes where they are seen; `worn_px` is how far edges are worn round."""
    hit, face = fragments.covered, fragments.face
    if len(hit) == 0:
        return
    finish = _finishes(scenes, rays.device)[triangles.instance[face]]
    normal = triangles.normals_at(face, weights)
    corners = triangles.faces[face]
    local = (triangles.local[corners] * weights[:, :, None]).sum(1)
    mark = (triangles.marks[corners] * weights).sum(1)
    view = buffer.view.view(-1, 3)[hit]
    normal = torch.where(dot(normal, view) < 0, -normal, normal)
    footprint = fragments.depth * float(length(rays[0, 0, 1] - rays[0, 0, 0]))
    buffer.normal.view(-1, 3)[hit] = normal
    normal, edge = _rounded(buffer, hit, worn_px)
    color, normal = decorate(finish, local, normal, edge, footprint, mark)
    buffer.normal.view(-1, 3)[hit] = normal
    buffer.albedo.view(-1, 3)[hit] = color.clamp(0.002, 0.95)
    buffer.roughness.view(-1)[hit] = finish[:, 3]
    buffer.translucency.view(-1)[hit] = finish[:, 8]


def _rounded(
    buffer: GBuffer, hit: Int64[Tensor, "p"], radius_px: int
) -> tuple[Float32[Tensor, "p 3"], Float32[Tensor, "p"]]:
    """Normals of meshes averaged over what lies near in the image, so that edges turn gradually, and
    how near an edge is: 0 within faces, up to 1 at edges."""
    sharp = buffer.normal.view(-1, 3)[hit]
    if radius_px < 1:
        return sharp, torch.zeros_like(sharp[:, 0])
    # Only about the meshes, with room for all three means; the grounds fill most images.
    images, rows, columns = _places(buffer.owner, hit)
    top, left = (max(0, int(at.min()) - 5 * radius_px) for at in (rows, columns))
    bottom, right = (int(at.max()) + 1 + 5 * radius_px for at in (rows, columns))
    near = (slice(None), slice(top, bottom), slice(left, right))
    soft = buffer.normal[near] * (buffer.owner[near] >= 0)[..., None]
    soft = soft.permute(0, 3, 1, 2).contiguous()
    means: list[Tensor] = []
    for reaches in ((radius_px, radius_px), (3 * radius_px,)):
        for reach in reaches:
            soft = box_mean(soft, reach, padding=reach)
        means.append(soft[images, :, rows - top, columns - left])
    return unit(means[0]), 1 - dot(unit(means[0]), means[1])[:, 0].clamp(0, 1)


def _places(images: Int64[Tensor, "b h w"], pixels: Int64[Tensor, "p"]) -> tuple[Tensor, ...]:
    """Image, row and column of pixels that are counted over the whole batch."""
    height, width = images.shape[1:]
    flat = pixels % (height * width)
    return pixels // (height * width), flat // width, flat % width


def _finishes(scenes: Sequence[Scene], device: torch.device) -> Float32[Tensor, "i 15"]:
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
            *p.T_world_mesh[:3, (p.finish.layer_axis + 1) % 3],
        ]
        for scene in scenes
        for p in scene.placed
    ]
    return torch.tensor(rows, dtype=torch.float32, device=device)
