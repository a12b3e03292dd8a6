"""The colour of what can be seen of a part's surface at a pose."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, UInt8

from asdfviz.datatypes import Frame, Mesh
from asdfviz.geometry.camera import nearest_pixels
from asdfviz.geometry.sampling import oriented_surface_points
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import apply

POINTS = 300
"""Of a part's surface."""
LEAST = 8
"""Fewer of them that can be seen tell nothing."""
MOST_OF = 0.5
"""Nor does less than this share of those that face the camera."""
AGREES = 0.008
"""Depth this near to a point of the surface shows it, metres: a finger on it is nearer, or beside it."""
DARK = 8.0
"""Added to all brightness (0 to 255), so that noise in the dark is no contrast."""
_LOGARITHMS = np.log(np.arange(256) + DARK)


def log_colors(rgb: UInt8[np.ndarray, "*pixels 3"]) -> Float64[np.ndarray, "*pixels 3"]:
    """Logarithms of (0 to 255) + DARK."""
    return _LOGARITHMS[rgb]


def tint(logarithms: Vector) -> Vector:
    """What a colour's channels differ by among themselves, whatever light falls on it; of `log_colors`."""
    return logarithms - logarithms.mean()


class SeenSurface:
    """Points of one part's surface, whose colours are read from frames."""

    def __init__(self, mesh: Mesh) -> None:
        """Take points all over it."""
        self._points, self._normals = oriented_surface_points(mesh.vertices, mesh.faces, POINTS)

    def seen(self, frame: Frame, T_camera_part: Transform) -> Vector | None:
        """Median logarithm of red, green and blue of what can be seen at a pose, of (0 to 255) + DARK.

        Returns:
            None where that is too little.
        """
        seen: Points = apply(T_camera_part, self._points)
        is_facing = np.einsum("ni,ni->n", self._normals @ T_camera_part[:3, :3].T, seen) < 0
        seen = seen[is_facing & (seen[:, 2] > 0)]
        if not len(seen):
            return None
        inside, rows, columns = nearest_pixels(seen, frame.camera.K, frame.rgb.shape[:2])
        facing = len(rows)
        if frame.depth is not None:
            measured = frame.depth[rows, columns]
            shows = (measured <= 0) | (np.abs(measured - seen[inside, 2]) < AGREES)
            rows, columns = rows[shows], columns[shows]
        if len(rows) < max(LEAST, MOST_OF * facing):
            return None
        return np.median(log_colors(frame.rgb[rows, columns]), axis=0)
