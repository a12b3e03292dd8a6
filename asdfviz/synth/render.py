"""From a scene's description to an RGB-D picture and its exact truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Int64

from asdfviz.geometry.shapes import Depth, Ids
from asdfviz.synth.description import Scene
from asdfviz.synth.gbuffer import FAR, GBuffer, Views, build_gbuffer, ground_mask, place_all
from asdfviz.synth.mesh_bank import MeshBank, Triangles
from asdfviz.synth.raster import Projected, rasterize
from asdfviz.synth.shading import ShadingConfig, shade

LARGEST = 2048
"""Side, in pixels, beyond which a silhouette is cut off."""


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A rendered scene before the sensor: linear light, exact depth, owners and visibility."""

    radiance: Float32[np.ndarray, "h w 3"]
    depth: Depth
    """Exact planar depth at pixel centres, metres; 0 beyond everything."""
    ids: Ids
    """Place in Scene.placed of what each pixel shows, -1 for the ground."""
    albedo: Float32[np.ndarray, "h w"]
    silhouette_px: Int64[np.ndarray, "n"]
    """Pixels of each placed thing if it stood alone, those outside the image included."""
    silhouette_box: Int64[np.ndarray, "n 4"]
    """Its box x, y, width, height; may reach outside the image."""


def render(
    scenes: Sequence[Scene],
    bank: MeshBank,
    *,
    rng: np.random.Generator,
    supersampling: float = 1.5,
    shading: ShadingConfig | None = None,
) -> list[Picture]:
    """Render scenes of one image size as a batch.

    Args:
        scenes: what to show.
        bank: the meshes that they name.
        rng: samples of the area lights.
        supersampling: colour is computed at this multiple of the image size and averaged.
        shading: quality of the light.
    """
    device = str(bank.vertices.device)
    triangles = place_all(scenes, bank)
    with torch.inference_mode():
        fine = build_gbuffer(
            scenes, triangles, Views.of(scenes, scale=supersampling, device=device)
        )
        radiance = shade(scenes, triangles, fine, rng=rng, config=shading or ShadingConfig())
        camera = scenes[0].camera
        radiance = torch.nn.functional.interpolate(
            radiance.permute(0, 3, 1, 2), size=(camera.height, camera.width), mode="area"
        ).permute(0, 2, 3, 1)
        albedo = torch.nn.functional.interpolate(
            fine.albedo.mean(dim=3)[:, None], size=(camera.height, camera.width), mode="area"
        )[:, 0]
        return _pictures(scenes, triangles, fine, radiance, albedo, device)


def _pictures(
    scenes: Sequence[Scene],
    triangles: Triangles,
    fine: GBuffer,
    radiance: torch.Tensor,
    albedo: torch.Tensor,
    device: str,
) -> list[Picture]:
    views = Views.of(scenes, scale=1.0, device=device)
    projected = views.project(triangles)
    exact = rasterize(projected, (len(scenes), views.height, views.width))
    depth = _with_grounds(scenes, views, torch.full_like(views.rays()[..., 0], FAR))
    owner = torch.full(depth.shape, -1, dtype=torch.int64, device=depth.device)
    nearer = exact.depth < depth.view(-1)[exact.covered]
    owner.view(-1)[exact.covered[nearer]] = triangles.instance[exact.face[nearer]]
    depth.view(-1)[exact.covered[nearer]] = exact.depth[nearer]
    depth = torch.where(depth < FAR, depth, 0.0)
    counts, boxes = silhouettes(scenes, triangles, projected)
    pictures: list[Picture] = []
    first = 0
    for i, scene in enumerate(scenes):
        last = first + len(scene.placed)
        ids = torch.where(owner[i] >= 0, owner[i] - first, -1).to(torch.int32)
        pictures.append(
            Picture(
                radiance[i].cpu().numpy(),
                depth[i].cpu().numpy(),
                ids.cpu().numpy(),
                albedo[i].cpu().numpy(),
                counts[first:last],
                boxes[first:last],
            )
        )
        first = last
    return pictures


def _with_grounds(scenes: Sequence[Scene], views: Views, depth: torch.Tensor) -> torch.Tensor:
    """Nearer of a depth and the grounds, at exact pixel centres."""
    rays, centers = views.rays(), views.centers()
    for i, scene in enumerate(scenes):
        for ground in scene.grounds:
            down = torch.where(rays[i, :, :, 2].abs() < 1e-4, -1e-4, rays[i, :, :, 2])
            reach = (ground.height - centers[i, 2]) / down
            x, y = (
                centers[i, 0] + rays[i, :, :, 0] * reach,
                centers[i, 1] + rays[i, :, :, 1] * reach,
            )
            mask = ground_mask(ground, x, y) & (reach > 0)
            depth[i] = torch.where(mask & (reach < depth[i]), reach, depth[i])
    return depth


def silhouettes(
    scenes: Sequence[Scene], triangles: Triangles, projected: Projected
) -> tuple[Int64[np.ndarray, "n"], Int64[np.ndarray, "n 4"]]:
    """Pixel count and box of every placed thing rendered alone, also beyond the image's border.

    All of them lie side by side in one atlas, each in a cell of the size of its own box, at most
    LARGEST pixels a side.
    """
    total = sum(len(s.placed) for s in scenes)
    corners = triangles.faces.reshape(-1)
    owner = triangles.instance.repeat_interleave(3)
    px = projected.points_px[corners]
    index = owner[:, None].expand(-1, 2)
    low = torch.full((total, 2), torch.inf, device=px.device)
    high = torch.full((total, 2), -torch.inf, device=px.device)
    low = low.scatter_reduce(0, index, px, "amin").floor().clamp(-LARGEST / 2, LARGEST / 2)
    high = high.scatter_reduce(0, index, px, "amax").ceil()
    size = (high - low + 1).clamp(1, LARGEST)
    rows, width = int(size[:, 1].max()), int(size[:, 0].sum())
    starts = size[:, 0].cumsum(0) - size[:, 0]
    cell = Projected(
        px + torch.stack([starts - low[:, 0], -low[:, 1]], dim=1)[owner],
        projected.depth[corners],
        torch.arange(len(corners), device=px.device).view(-1, 3),
        torch.zeros_like(triangles.image),
    )
    atlas = rasterize(cell, (1, rows, width))
    owners = triangles.instance[atlas.face]
    # What is cut off at a cell's end must not count for its neighbour.
    inside = (atlas.covered % width >= starts[owners]) & (
        atlas.covered % width < (starts + size[:, 0])[owners]
    )
    covered, owners = atlas.covered[inside], owners[inside]
    counts = torch.bincount(owners, minlength=total)
    return counts.cpu().numpy(), _tight_boxes(covered, owners, starts, low, width, total)


def _tight_boxes(
    covered: torch.Tensor,
    owners: torch.Tensor,
    starts: torch.Tensor,
    low: torch.Tensor,
    width: int,
    total: int,
) -> Int64[np.ndarray, "n 4"]:
    """Boxes of the covered pixels in image coordinates."""
    u = covered % width - starts.long()[owners] + low[:, 0].long()[owners]
    v = covered // width + low[:, 1].long()[owners]
    huge = 1 << 30
    ends: list[torch.Tensor] = []
    for values in (u, v):
        first = torch.full((total,), huge, dtype=torch.int64, device=u.device)
        last = torch.full((total,), -huge, dtype=torch.int64, device=u.device)
        ends += [
            first.scatter_reduce(0, owners, values, "amin"),
            last.scatter_reduce(0, owners, values, "amax"),
        ]
    x0, x1, y0, y1 = ends
    seen = x1 >= x0
    box = torch.stack([x0, y0, x1 - x0 + 1, y1 - y0 + 1], dim=1)
    return torch.where(seen[:, None], box, 0).cpu().numpy()
