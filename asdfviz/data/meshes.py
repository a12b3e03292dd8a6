"""Reads the mesh of one part, in metres, and refuses what cannot be one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from asdfviz.datatypes import Mesh
from asdfviz.errors import AssemblyError

METRES_PER_UNIT = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


def read_mesh(path: Path, *, unit: str, part: str) -> Mesh:
    """Read a PLY, STL or OBJ file and scale it to metres; the frame stays the CAD frame.

    Raises:
        AssemblyError: the file is missing, is no mesh, or is not finite.
    """
    if not path.is_file():
        raise AssemblyError(f"part '{part}': mesh {path} does not exist")
    try:
        loaded = trimesh.load(path, force="mesh", process=False)
    except Exception as error:
        raise AssemblyError(f"part '{part}': {path} cannot be read as a mesh: {error}") from error
    vertices = np.array(loaded.vertices, dtype=np.float64) * METRES_PER_UNIT[unit]
    faces = np.array(loaded.faces, dtype=np.int32)
    if len(vertices) == 0 or len(faces) == 0:
        raise AssemblyError(f"part '{part}': {path} holds no triangles")
    if not np.isfinite(vertices).all():
        raise AssemblyError(f"part '{part}': {path} has vertices that are not finite")
    vertices.flags.writeable = False
    faces.flags.writeable = False
    return Mesh(vertices, faces)
