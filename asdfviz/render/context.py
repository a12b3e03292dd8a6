"""One OpenGL context with its scene; lives in the render thread and nowhere else.

Meshes stay on the GPU between calls. Nothing here may be touched from another thread.
"""

from __future__ import annotations

import os
from collections import Counter, OrderedDict
from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import Any, cast

import numpy as np
import trimesh

from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Depth, Ids, Intrinsics, Rgb, Transform
from asdfviz.render.gl_thread import Pyrender, load_pyrender, no_opengl

NEAR, FAR = 0.02, 20.0
"""Clipping planes, metres; 24 bits of depth then resolve 3 um at 1 m."""
_trimesh = cast(Any, trimesh)
_KEPT_MESHES = 64
_SMOOTH_SAMPLES = 4
_CREASE_ANGLE = np.deg2rad(32.0)
"""Faces that meet at a larger angle keep a sharp edge."""
_GL_FROM_CV = np.diag([1.0, -1.0, -1.0, 1.0])
"""From OpenCV's camera axes to OpenGL's."""


class Context:
    """Draws into a buffer of one size; `smooth` pictures are antialiased, others are exact."""

    def __init__(self, width: int, height: int, *, smooth: bool) -> None:
        self._gl: Pyrender = load_pyrender()
        self._samples = _SMOOTH_SAMPLES if smooth else 0
        self._smooth = smooth
        try:
            device = self._gl.egl.get_device_by_index(int(os.environ.get("EGL_DEVICE_ID", "0")))
            self._platform = self._gl.egl.EGLPlatform(width, height, device=device)
            self._platform.init_context()
            self._platform.make_current()
            self._renderer = self._gl.renderer.Renderer(width, height)
        except Exception as error:
            # pyrender asserts, PyOpenGL raises its own kinds, ctypes others.
            raise no_opengl(error) from error
        self._scene = self._gl.pyrender.Scene(bg_color=[0, 0, 0, 1], ambient_light=[0.25] * 3)
        self._camera = self._gl.pyrender.IntrinsicsCamera(1, 1, 0, 0, znear=NEAR, zfar=FAR)
        self._scene.add(self._camera, pose=np.eye(4))
        self._nodes: OrderedDict[tuple[int, int, bytes], tuple[Mesh, Any]] = OrderedDict()
        self._add_lights()

    def depth_and_ids(
        self, meshes: Sequence[Mesh], Ts_camera_mesh: Sequence[Transform], K: Intrinsics
    ) -> tuple[Depth, Ids]:
        """Planar depth (metres, 0 = nothing) and the place of the front mesh (-1 = none)."""
        nodes = self._show(meshes, Ts_camera_mesh, [b""] * len(meshes))
        codes = {
            node: ((i + 1) & 255, ((i + 1) >> 8) & 255, (i + 1) >> 16)
            for i, node in enumerate(nodes)
        }
        picture, depth = self._draw(K, self._gl.flags.SEG, codes)
        ids = picture[..., 0].astype(np.int32) - 1
        # Most scenes need one byte; an integer product over all three costs more than the drawing.
        if len(meshes) > 254:
            ids += (picture[..., 1].astype(np.int32) << 8) + (
                picture[..., 2].astype(np.int32) << 16
            )
        return np.ascontiguousarray(depth, dtype=np.float32), ids

    def color(
        self,
        meshes: Sequence[Mesh],
        Ts_camera_mesh: Sequence[Transform],
        colors: Sequence[np.ndarray],
        K: Intrinsics,
    ) -> Rgb:
        """Shaded picture on black."""
        keys = [bytes(np.asarray(c, dtype=np.uint8)[:3]) for c in colors]
        self._show(meshes, Ts_camera_mesh, keys)
        picture, _ = self._draw(K, self._gl.flags.NONE, None)
        return np.ascontiguousarray(picture, dtype=np.uint8)

    def close(self) -> None:
        """Free what this context holds on the GPU.

        The display is left alone: all contexts share it, and ending it would end them too.
        """
        self._platform.make_current()
        self._renderer.delete()
        self._gl.egl.egl.eglDestroyContext(self._platform._egl_display, self._platform._egl_context)
        self._platform._egl_context = None
        self._platform._egl_display = None
        self._nodes.clear()

    def _add_lights(self) -> None:
        # Fixed to the camera: a key from upper left behind it and a weak fill from the right.
        for direction, strength in (((-0.5, 0.8, 1.0), 2.1), ((0.9, -0.1, 0.5), 0.7)):
            pose = np.eye(4)
            pose[:3, :3] = _trimesh.geometry.align_vectors([0, 0, 1], direction)[:3, :3]
            light = self._gl.pyrender.DirectionalLight(color=np.ones(3), intensity=strength)
            self._scene.add(light, pose=pose)

    def _show(
        self,
        meshes: Sequence[Mesh],
        Ts_camera_mesh: Sequence[Transform],
        colors: Sequence[bytes],
    ) -> list[Any]:
        for _, node in self._nodes.values():
            node.mesh.is_visible = False
        seen: Counter[tuple[int, bytes]] = Counter()
        shown: list[Any] = []
        for mesh, T_camera_mesh, color in zip(meshes, Ts_camera_mesh, colors, strict=True):
            # One mesh may be there several times: each copy is a node of its own.
            copy = seen[id(mesh), color]
            seen[id(mesh), color] += 1
            node = self._node((id(mesh), copy, color), mesh)
            node.mesh.is_visible = True
            self._scene.set_pose(node, _GL_FROM_CV @ T_camera_mesh)
            shown.append(node)
        self._forget(keep=len(shown))
        return shown

    def _node(self, key: tuple[int, int, bytes], mesh: Mesh) -> Any:
        if key not in self._nodes:
            # The entry holds the mesh, so that its id cannot pass to another one.
            self._nodes[key] = (mesh, self._scene.add(self._upload(mesh, key[2])))
        self._nodes.move_to_end(key)
        return self._nodes[key][1]

    def _upload(self, mesh: Mesh, color: bytes) -> Any:
        surface = _trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
        smooth = bool(color)
        if smooth:
            surface = _trimesh.graph.smooth_shade(surface, angle=_CREASE_ANGLE)
        linear = (np.frombuffer(color, dtype=np.uint8) / 255.0) ** 2.2 if color else np.ones(3)
        material = self._gl.pyrender.MetallicRoughnessMaterial(
            baseColorFactor=[*linear, 1.0],
            metallicFactor=0.0,
            roughnessFactor=0.55,
            doubleSided=True,
        )
        return self._gl.pyrender.Mesh.from_trimesh(surface, material=material, smooth=smooth)

    def _forget(self, *, keep: int) -> None:
        while len(self._nodes) > max(_KEPT_MESHES, keep):
            _, (_, node) = self._nodes.popitem(last=False)
            self._scene.remove_node(node)

    def _draw(self, K: Intrinsics, flags: Any, codes: dict[Any, Any] | None) -> tuple[Any, Any]:
        # OpenGL's pixel centres lie at halves, ours at whole numbers.
        self._camera.fx, self._camera.fy = float(K[0, 0]), float(K[1, 1])
        self._camera.cx, self._camera.cy = float(K[0, 2]) + 0.5, float(K[1, 2]) + 0.5
        self._platform.make_current()
        with _samples(self._gl.renderer, self._samples):
            return self._renderer.render(self._scene, flags | self._gl.flags.OFFSCREEN, codes)


@contextmanager
def _samples(module: Any, count: int) -> Generator[None]:
    """Make pyrender's buffers with `count` samples a pixel; it always asks for four.

    Samples blur depth and ids at every edge. Only the render thread gets here.
    """
    original = module.glRenderbufferStorageMultisample

    def storage(target: Any, _asked: Any, form: Any, width: Any, height: Any) -> None:
        original(target, count, form, width, height)

    module.glRenderbufferStorageMultisample = storage
    try:
        yield
    finally:
        module.glRenderbufferStorageMultisample = original
