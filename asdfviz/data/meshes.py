"""Reads the mesh of one part, in metres, refuses what cannot be one, and spreads keypoints on it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import trimesh

from asdfviz.datatypes import KEYPOINTS, Mesh
from asdfviz.errors import AssemblyError
from asdfviz.geometry.sampling import farthest_points, surface_points
from asdfviz.geometry.shapes import Points

_SURFACE_POINTS = 2000
METRES_PER_UNIT = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def load_any(path: Path) -> Any:
    """Load a mesh file as trimesh has it, corners as in the file; its stubs know no mesh."""
    return cast(Any, trimesh).load(path, force="mesh", process=False)


def read_mesh(path: Path, *, unit: str, part: str) -> Mesh:
    """Read a PLY, STL or OBJ file and scale it to metres; the frame stays the CAD frame.

    Raises:
        AssemblyError: the file is missing or a folder, is no mesh, or is not finite.
    """
    if not path.is_file():
        trouble = "is a folder" if path.is_dir() else "does not exist"
        raise AssemblyError(
            f"part '{part}': mesh {path} {trouble}; 'mesh' names a PLY, OBJ or STL file, "
            "relative to assembly.yaml"
        )
    try:
        loaded = load_any(path)
    except Exception as error:
        raise AssemblyError(f"part '{part}': {path} cannot be read as a mesh: {error}") from error
    vertices = np.array(loaded.vertices, dtype=np.float64) * METRES_PER_UNIT[unit]
    faces = np.array(loaded.faces, dtype=np.int32)
    if len(vertices) == 0 or len(faces) == 0:
        raise AssemblyError(f"part '{part}': {path} holds no triangles")
    if not np.isfinite(vertices).all():
        raise AssemblyError(f"part '{part}': {path} has vertices that are not finite")
    outside = faces[(faces < 0) | (faces >= len(vertices))]
    if len(outside):
        raise AssemblyError(
            f"part '{part}': {path} has a triangle with corner {outside[0]}, "
            f"of corners 0 to {len(vertices) - 1}"
        )
    sides = vertices[faces[:, 1:]] - vertices[faces[:, :1]]
    if not np.cross(sides[:, 0], sides[:, 1]).any():
        raise AssemblyError(f"part '{part}': {path} has no area: all its triangles are flat lines")
    vertices.flags.writeable = False
    faces.flags.writeable = False
    return Mesh(vertices, faces)


def default_keypoints(mesh: Mesh) -> Points:
    """The 17 keypoints (metres) of a part whose description names none: farthest vertices.

    A mesh of fewer corners, a plain box say, takes points of its faces too.
    """
    vertices = mesh.vertices
    if len(np.unique(vertices, axis=0)) >= KEYPOINTS:
        return farthest_points(vertices, KEYPOINTS)
    spread = surface_points(vertices, mesh.faces, _SURFACE_POINTS)
    return farthest_points(np.concatenate([vertices, spread]), KEYPOINTS)
