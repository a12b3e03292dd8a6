"""From a scene's description to an RGB-D picture and its exact truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Int64
from torch import Tensor

from asdfviz.geometry.shapes import Depth, Ids
from asdfviz.synth.description import Scene
from asdfviz.synth.gbuffer import Views, build_gbuffer, exact_depth, place_all
from asdfviz.synth.grounds import FAR
from asdfviz.synth.mesh_bank import MeshBank, Triangles
from asdfviz.synth.raster import Cells, Projected, rasterize_cells
from asdfviz.synth.shading import ShadingConfig, shade
from asdfviz.synth.shrinking import area_means

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
    casters = triangles if bank.casters is None else place_all(scenes, bank.casters)
    with torch.inference_mode():
        views = Views.of(scenes, scale=supersampling, device=device)
        fine = build_gbuffer(scenes, triangles, views)
        light = shading or ShadingConfig()
        radiance = shade(scenes, casters, fine, views, rng=rng, config=light)
        camera = scenes[0].camera
        albedo = fine.albedo.mean(dim=3, keepdim=True)
        exact = (fine.depth, fine.owner) if supersampling == 1 else None
        if exact is None:
            radiance, albedo = (
                area_means(each, camera.height, camera.width) for each in (radiance, albedo)
            )
        return _pictures(scenes, triangles, exact, radiance, albedo[..., 0], device)


def _pictures(
    scenes: Sequence[Scene],
    triangles: Triangles,
    exact: tuple[Tensor, Tensor] | None,
    radiance: Tensor,
    albedo: Tensor,
    device: str,
) -> list[Picture]:
    """Add what is measured at the image's own pixels; `exact` if that is known already."""
    views = Views.of(scenes, scale=1.0, device=device)
    projected = views.project(triangles)
    depth, owner = exact or exact_depth(scenes, triangles, views, projected)
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


def silhouettes(
    scenes: Sequence[Scene], triangles: Triangles, projected: Projected
) -> tuple[Int64[np.ndarray, "n"], Int64[np.ndarray, "n 4"]]:
    """Pixel count and box of every placed thing rendered alone, also beyond the image's border.

    Each is drawn into a cell of the size of its own box, at most LARGEST pixels a side.
    """
    total = sum(len(s.placed) for s in scenes)
    px = projected.points_px
    index = triangles.vertex_instance[:, None].expand(-1, 2)
    low = torch.full((total, 2), torch.inf, device=px.device)
    high = torch.full((total, 2), -torch.inf, device=px.device)
    camera = scenes[0].camera
    # A cell begins no farther off than it may be large; what is in the picture begins before its end.
    farthest = max(LARGEST / 2, camera.width, camera.height)
    low = low.scatter_reduce(0, index, px, "amin").floor().clamp(-LARGEST / 2, farthest)
    high = high.scatter_reduce(0, index, px, "amax").ceil()
    size = (high - low + 1).clamp(1, LARGEST).long()
    cells = Cells.of_sizes(size[:, 0], size[:, 1])
    alone = Projected(
        px - low[triangles.vertex_instance], projected.depth, triangles.faces, triangles.instance
    )
    atlas = rasterize_cells(alone, cells)
    owners = triangles.instance[atlas.face]
    counts = torch.bincount(owners, minlength=total)
    return counts.cpu().numpy(), _tight_boxes(atlas.covered, owners, cells, low.long())


def _tight_boxes(
    covered: Int64[Tensor, "p"],
    owners: Int64[Tensor, "p"],
    cells: Cells,
    low: Int64[Tensor, "n 2"],
) -> Int64[np.ndarray, "n 4"]:
    """Boxes of the covered pixels in image coordinates; `low` is each cell's first pixel there."""
    total, huge = len(low), 1 << 30
    place, width = covered - cells.start[owners], cells.width[owners]
    u, v = place % width + low[owners, 0], place // width + low[owners, 1]
    ends: list[Tensor] = []
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
