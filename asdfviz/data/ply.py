"""Writes a mesh as a binary PLY in millimetres, the form in which parts are committed."""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Mesh

_HEADER = """ply
format binary_little_endian 1.0
comment millimetres
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
"""


def ply_bytes(mesh: Mesh) -> bytes:
    """Return the file's bytes; vertices (metres) become float32 millimetres."""
    vertices = np.ascontiguousarray(mesh.vertices * 1e3, dtype="<f4")
    rows = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"] = 3
    rows["corners"] = mesh.faces
    header = _HEADER.format(vertices=len(vertices), faces=len(rows))
    return header.encode("ascii") + vertices.tobytes() + rows.tobytes()
