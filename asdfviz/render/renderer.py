"""Draws meshes as depth, ids or colour: the door to OpenGL for every other room.

Safe to call from any thread; the drawing itself happens in the one render thread.
"""

from __future__ import annotations

import atexit
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from asdfviz.datatypes import Mesh
from asdfviz.errors import RenderError
from asdfviz.geometry.shapes import Depth, Ids, Intrinsics, Rgb, Transform
from asdfviz.render.gl_thread import render_thread

if TYPE_CHECKING:
    from asdfviz.render.context import Context


class Renderer:
    """Draws pictures of one size. Crop or zoom by the intrinsics: a new size is a new context.

    Raises:
        RenderError: EGL is missing, or the size is not positive.
    """

    def __init__(self, width: int, height: int) -> None:
        if width < 1 or height < 1:
            raise RenderError(f"cannot draw a picture of {width} x {height} pixels")
        self.width = width
        self.height = height
        self._thread = render_thread()
        self._contexts: dict[bool, Context] = {}
        self._closed = False
        self._thread.call(lambda: self._context(smooth=False))
        atexit.register(self.close)

    def depth_and_ids(
        self, meshes: Sequence[Mesh], Ts_camera_mesh: Sequence[Transform], K: Intrinsics
    ) -> tuple[Depth, Ids]:
        """Return planar depth (metres, 0 = nothing) and which mesh is in front (-1 = none).

        Exact to the pixel: every pixel is sampled once, in its centre.

        Args:
            meshes: held by reference between calls; hand in the same objects to be fast.
            Ts_camera_mesh: one a mesh.
            K: intrinsics for this renderer's width and height; skew is not drawn.
        """
        return self._thread.call(
            lambda: self._context(smooth=False).depth_and_ids(meshes, Ts_camera_mesh, K)
        )

    def color(
        self,
        meshes: Sequence[Mesh],
        Ts_camera_mesh: Sequence[Transform],
        colors: Sequence[np.ndarray],
        K: Intrinsics,
        *,
        antialias: bool = True,
    ) -> Rgb:
        """Return a shaded picture on black, lit from behind the camera.

        Args:
            meshes: as in `depth_and_ids`.
            Ts_camera_mesh: one a mesh.
            colors: one a mesh, sRGB, 0 to 255.
            K: as in `depth_and_ids`.
            antialias: without it, the parts' pixels are exactly those of `depth_and_ids`.
        """
        return self._thread.call(
            lambda: self._context(smooth=antialias).color(meshes, Ts_camera_mesh, colors, K)
        )

    def close(self) -> None:
        """Free the contexts; a closed renderer cannot draw. Closing twice does no harm."""
        if not self._closed:
            self._closed = True
            atexit.unregister(self.close)
            self._thread.call(self._free)

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _context(self, *, smooth: bool) -> Context:
        from asdfviz.render.context import Context

        if self._closed:
            raise RenderError("this renderer was closed")
        if smooth not in self._contexts:
            self._contexts[smooth] = Context(self.width, self.height, smooth=smooth)
        return self._contexts[smooth]

    def _free(self) -> None:
        for context in self._contexts.values():
            context.close()
        self._contexts.clear()
