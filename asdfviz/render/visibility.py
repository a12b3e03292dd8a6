"""How much of every part can be seen: its pixels in the scene against its pixels alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from asdfviz.datatypes import Assembly, Camera, FrameTruth, Mesh
from asdfviz.geometry.camera import scaled_intrinsics
from asdfviz.geometry.shapes import Depth, Intrinsics, Transform
from asdfviz.geometry.transforms import apply
from asdfviz.render.renderer import Renderer

OCCLUSION_TOLERANCE = 0.015
"""A measured surface hides a part if it lies this much nearer, metres (BOP's delta for visib)."""
_WIDER = 3
"""How much wider a view finds the part of a silhouette outside the picture (as BOP does)."""


def lacks_visibility(frame: FrameTruth, assembly: Assembly) -> bool:
    """Whether a part of the frame has a true pose but no visible share."""
    return any(name in assembly.parts and name not in frame.visible for name in frame.T_camera_part)


class MissingShares:
    """Renders the visible shares that truth leaves out. OpenGL is loaded once one is missing."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self._renderers: dict[tuple[int, int], Renderer] = {}

    def filled(self, frame: FrameTruth, camera: Camera, depth: Depth | None) -> FrameTruth:
        """The truth with a share of every part of the assembly; shares that it has stay.

        Args:
            frame: the truth.
            camera: of the frame.
            depth: as measured there, metres: what it has in front of a part hides it, as hands do.

        Raises:
            RenderError: a share is missing and nothing can be drawn here.
        """
        if not lacks_visibility(frame, self._assembly):
            return frame
        size = (camera.width, camera.height)
        if size not in self._renderers:
            self._renderers[size] = Renderer(*size)
        rendered = visible_fractions(
            frame.T_camera_part,
            self._assembly,
            camera,
            depth=depth,
            renderer=self._renderers[size],
        )
        return replace(frame, visible={**rendered, **frame.visible})

    def __enter__(self) -> MissingShares:
        return self

    def __exit__(self, *_: object) -> None:
        for renderer in self._renderers.values():
            renderer.close()


def visible_fractions(
    poses: Mapping[str, Transform],
    assembly: Assembly,
    camera: Camera,
    *,
    depth: Depth | None = None,
    renderer: Renderer,
) -> dict[str, float]:
    """Return the visible share, 0 to 1, of each posed part's whole silhouette.

    Other parts, the picture's border and, with `depth`, whatever was measured in front of a part
    hide it; where depth has a hole, the part counts as seen (as in BOP's visib_fract).

    Args:
        poses: T_camera_part of the parts in the scene.
        assembly: where the meshes come from.
        camera: of the picture; the renderer has its size.
        depth: the measured depth, in metres, of the same camera.
        renderer: of the camera's size.
    """
    names = [name for name in poses if name in assembly.parts]
    if not names:
        return {}
    meshes = [assembly.parts[name].mesh for name in names]
    Ts_camera_part = [poses[name] for name in names]
    scene_depth, ids = renderer.depth_and_ids(meshes, Ts_camera_part, camera.K)
    seen = ids >= 0
    if depth is not None:
        seen &= (depth <= 0) | (scene_depth <= depth + OCCLUSION_TOLERANCE)
    pixels = np.bincount(ids[seen], minlength=len(names))
    return {
        name: _share(int(pixels[i]), meshes[i], Ts_camera_part[i], camera, renderer)
        for i, name in enumerate(names)
    }


def _share(
    pixels: int, mesh: Mesh, T_camera_part: Transform, camera: Camera, renderer: Renderer
) -> float:
    if pixels == 0:
        return 0.0
    _, alone = renderer.depth_and_ids([mesh], [T_camera_part], camera.K)
    whole = float((alone >= 0).sum())
    if _is_cut(mesh, T_camera_part, camera):
        whole /= max(_inside_share(mesh, T_camera_part, camera, renderer), 1e-6)
    return float(min(pixels / whole, 1.0))


def _is_cut(mesh: Mesh, T_camera_part: Transform, camera: Camera) -> bool:
    points = apply(T_camera_part, mesh.vertices)
    if (points[:, 2] <= 0).any():
        return True
    u = camera.K[0, 0] * points[:, 0] / points[:, 2] + camera.K[0, 2]
    v = camera.K[1, 1] * points[:, 1] / points[:, 2] + camera.K[1, 2]
    limit = np.array([camera.width - 0.5, camera.height - 0.5])
    low, high = np.array([u.min(), v.min()]), np.array([u.max(), v.max()])
    return bool((low < -0.5).any() or (high > limit).any())


def _inside_share(
    mesh: Mesh, T_camera_part: Transform, camera: Camera, renderer: Renderer
) -> float:
    """Share of the silhouette that lies in the picture, from a view three times as wide."""
    _, ids = renderer.depth_and_ids([mesh], [T_camera_part], _wide(camera))
    found = ids >= 0
    margin_x, margin_y = camera.width // _WIDER, camera.height // _WIDER
    inside = found[margin_y : 2 * margin_y, margin_x : 2 * margin_x].sum()
    return float(inside) / max(float(found.sum()), 1.0)


def _wide(camera: Camera) -> Intrinsics:
    K = scaled_intrinsics(camera.K, 1 / _WIDER, 1 / _WIDER)
    K[0, 2] += camera.width // _WIDER
    K[1, 2] += camera.height // _WIDER
    return K
