"""Draws a generated sequence again with another renderer (pyrender's plain colour).

Nothing that is tuned to the look of one shader should get past a test: the same scenes with the same
hands, clutter and table, the same depth and the same truth, but other light and materials.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float64, UInt8

from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.data.scene_files import find_scene_files
from asdfviz.data.scene_objects import SCENE_GT
from asdfviz.datatypes import Mesh
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Rgb, Transform, Vector
from asdfviz.render.renderer import Renderer
from asdfviz.synth.assets import Assets
from asdfviz.synth.bop_writer import write_image
from asdfviz.synth.description import Ground, Placed, Scene
from asdfviz.synth.mesh_bank import MeshBank

JPEG_QUALITY = 92
FARTHEST = 3.0
"""Endless grounds are drawn to this distance from the scene's centre, metres."""
SEQUENCE = "sequence.json"
_ROUND = 96
"""Corners of a round table."""
_COPIED = ("depth", "labels", "mask", "mask_visib")


class PlainPictures:
    """Draws scenes in plain colours, one renderer and one copy of every mesh for all of them."""

    def __init__(self, assets: Assets, *, width: int, height: int) -> None:
        self._renderer = Renderer(width, height)
        self._assets = assets
        self._meshes: dict[tuple[int, bytes], Mesh] = {}
        self._grounds: dict[int, tuple[Ground, Mesh]] = {}

    def draw(self, scene: Scene) -> Rgb:
        """The picture of one scene."""
        meshes: list[Mesh] = []
        poses: list[Transform] = []
        colors: list[np.ndarray] = []
        for ground in scene.grounds:
            meshes.append(self._ground(ground, scene.target))
            poses.append(scene.T_camera_world)
            colors.append(srgb(ground.colors.mean(axis=0)))
        for placed in scene.placed:
            mesh, T_world_mesh = self._mesh(placed)
            meshes.append(mesh)
            poses.append(scene.T_camera_world @ T_world_mesh)
            colors.append(srgb(placed.finish.color))
        return self._renderer.color(meshes, poses, colors, scene.camera.K)

    def close(self) -> None:
        """Free the renderer."""
        self._renderer.close()

    def _mesh(self, placed: Placed) -> tuple[Mesh, Transform]:
        """The mesh with its stretch (mirrored for left hands), and the rigid rest of its pose."""
        A = placed.T_world_mesh[:3, :3]
        stretch: Vector = np.sqrt((A * A).sum(axis=0))
        if np.linalg.det(A) < 0:
            stretch[0] *= -1
        key = (placed.mesh, np.round(stretch, 6).tobytes())
        if key not in self._meshes:
            self._meshes[key] = stretched(bank_mesh(self._assets.bank, placed.mesh), stretch)
        T = placed.T_world_mesh.copy()
        T[:3, :3] = A / stretch
        return self._meshes[key], T

    def _ground(self, ground: Ground, middle: Vector) -> Mesh:
        if id(ground) not in self._grounds:
            # The entry holds the ground, so that its id cannot pass to another one.
            self._grounds[id(ground)] = (ground, ground_mesh(ground, middle[:2]))
        return self._grounds[id(ground)][1]


def rerender(
    source: Path,
    folder: Path,
    *,
    scenes: Sequence[Scene],
    assets: Assets,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> bool:
    """Write the scene folder `source` again with plain pictures; what is there already stays.

    Args:
        source: a finished scene folder.
        folder: the one to write; depth, labels, masks and truth are copied.
        scenes: what the frames of `source` show, by frame number.
        assets: the meshes that the scenes name.
        progress: called with frames done and in all.
        stop: asked before every frame; true ends the job, which can be taken up later.

    Returns:
        Whether everything is there.

    Raises:
        InputError: source and scenes do not belong together, or the folder holds something else.
        RenderError: OpenGL is missing.
    """
    files = find_scene_files(source)
    if list(files.rgb) != list(range(len(scenes))):
        raise InputError(f"{source} has {len(files.rgb)} frames, not {len(scenes)}: make it anew")
    _begin(source, folder)
    camera = scenes[0].camera
    pictures = PlainPictures(assets, width=camera.width, height=camera.height)
    try:
        for frame, scene in enumerate(scenes):
            if stop is not None and stop():
                return False
            target = folder / "rgb" / f"{frame:06d}.jpg"
            if not target.is_file():
                bgr = cv2.cvtColor(pictures.draw(scene), cv2.COLOR_RGB2BGR)
                write_image(target, bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
            if progress is not None:
                progress(frame + 1, len(scenes))
    finally:
        pictures.close()
    _copy_rest(source, folder)
    return True


def _begin(source: Path, folder: Path) -> None:
    """Note what is drawn again, or see that the folder was begun for the same."""
    about = json.loads((source / SEQUENCE).read_text(encoding="utf-8")) | {"renderer": "pyrender"}
    file = folder / SEQUENCE
    if file.is_file():
        if json.loads(file.read_text(encoding="utf-8")) != about:
            raise InputError(f"{folder} was drawn from another sequence: take another folder")
        return
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder} holds something else: take another folder")
    write_text(file, json.dumps(about, indent=1) + "\n")


def _copy_rest(source: Path, folder: Path) -> None:
    """Copy all but the colour; the truth comes last, as the sign of a complete folder."""
    for room in _COPIED:
        for file in sorted((source / room).glob("[!.]*")):
            target = folder / room / file.name
            if not target.is_file():
                write_bytes(target, file.read_bytes())
    names = [f.name for f in sorted(source.glob("*.json")) if f.name not in (SEQUENCE, SCENE_GT)]
    for name in (*names, SCENE_GT):
        write_bytes(folder / name, (source / name).read_bytes())


def srgb(color: Vector) -> UInt8[np.ndarray, "3"]:
    """8-bit sRGB of a linear colour (0 to 1)."""
    return np.round(np.clip(color, 0, 1) ** (1 / 2.2) * 255).astype(np.uint8)


def bank_mesh(bank: MeshBank, index: int) -> Mesh:
    """A mesh as it was put into the bank."""
    v_start, v_count = (int(x) for x in bank.vertex_ranges[index])
    f_start, f_count = (int(x) for x in bank.face_ranges[index])
    vertices = bank.vertices[v_start : v_start + v_count].cpu().numpy().astype(np.float64)
    faces = bank.faces[f_start : f_start + f_count].cpu().numpy().astype(np.int32)
    return Mesh(vertices, faces)


def stretched(mesh: Mesh, factors: Vector) -> Mesh:
    """A mesh scaled along its axes; where it is mirrored, its faces still look outwards."""
    faces = mesh.faces if float(np.prod(factors)) > 0 else np.ascontiguousarray(mesh.faces[:, ::-1])
    return Mesh(mesh.vertices * factors, faces)


def ground_mesh(ground: Ground, middle: Float64[np.ndarray, "2"]) -> Mesh:
    """A flat ground as a fan of triangles, world frame; endless ones end FARTHEST from `middle`."""
    if ground.circle is not None:
        x, y, radius = ground.circle
        angles = np.arange(_ROUND) * (2 * np.pi / _ROUND)
        corners = np.array([x, y]) + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        corners = middle + FARTHEST * square
    for edge in ground.edges:
        corners = _cut(corners, edge)
    vertices = np.concatenate([corners, np.full((len(corners), 1), ground.height)], axis=1)
    fan = [[0, k, k + 1] for k in range(1, len(corners) - 1)]
    return Mesh(vertices, np.array(fan, np.int32).reshape(-1, 3))


def _cut(corners: np.ndarray, edge: np.ndarray) -> np.ndarray:
    """What of a convex polygon lies in the half plane a x + b y <= c."""
    beyond = corners @ edge[:2] - edge[2]
    kept: list[np.ndarray] = []
    for k in range(len(corners)):
        following = (k + 1) % len(corners)
        if beyond[k] <= 0:
            kept.append(corners[k])
        if (beyond[k] <= 0) != (beyond[following] <= 0):
            share = beyond[k] / (beyond[k] - beyond[following])
            kept.append(corners[k] + share * (corners[following] - corners[k]))
    return np.array(kept).reshape(-1, 2)
