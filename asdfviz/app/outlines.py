"""The edges that make a CAD part readable as lines: creases and open borders. Pure."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from asdfviz.datatypes import Mesh

SHARP = np.radians(28.0)
"""Faces that meet at a larger angle make a crease."""
MOST = 1500
"""Segments a part; more would be a scan's noise or a fine thread, of which the sharpest are kept
everywhere on the part."""
CELLS = 10
"""Cells along the part's longest side that share the segments: a thread's do not take the others' place."""
_GRID = 1e-6
"""Metres: vertices closer than this are one."""


def feature_edges(mesh: Mesh) -> Float32[np.ndarray, "s 2 3"]:
    """Segments (metres, part frame) of every crease and border; of too many, the sharpest of every cell."""
    vertices, faces = _welded(mesh)
    if not len(faces):
        return np.zeros((0, 2, 3), np.float32)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    starts = np.flatnonzero(np.r_[True, (edges[1:] != edges[:-1]).any(axis=1)])
    uses = np.diff(np.r_[starts, len(edges)])
    normals = _normals(vertices, faces)
    # An edge that not exactly two faces share is a border: as sharp as can be.
    angle = np.full(len(starts), np.pi)
    paired = np.flatnonzero(uses == 2)
    a, b = normals[owner[starts[paired]]], normals[owner[starts[paired] + 1]]
    angle[paired] = np.arccos(np.clip((a * b).sum(axis=1), -1, 1))
    sharp = np.flatnonzero(angle > SHARP)
    sharp = sharp[np.argsort(-angle[sharp], kind="stable")]
    segments = vertices[edges[starts[sharp]]].astype(np.float32)
    return segments if len(segments) <= MOST else segments[_first_of_cells(segments)[:MOST]]


def _first_of_cells(segments: np.ndarray) -> np.ndarray:
    """The segments' order if each cell in turn gives its next one: no cell goes empty for a full one."""
    middles = segments.mean(axis=1)
    low, high = middles.min(axis=0), middles.max(axis=0)
    places = (middles - low) / max((high - low).max(), _GRID) * CELLS
    _, cells = np.unique(places.astype(np.int64), axis=0, return_inverse=True)
    cells = cells.reshape(-1)
    by_cell = np.argsort(cells, kind="stable")
    counts = np.bincount(cells)
    turns = np.arange(len(cells)) - np.repeat(np.cumsum(counts) - counts, counts)
    return by_cell[np.argsort(turns, kind="stable")]


def _welded(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Join equal vertices, which files store once a face, and drop faces without area."""
    _, first, inverse = np.unique(
        np.round(mesh.vertices / _GRID).astype(np.int64),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    vertices = mesh.vertices[first]
    faces = inverse.reshape(-1)[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (a != c)]
    area = np.linalg.norm(_crosses(vertices, faces), axis=1)
    return vertices, faces[area > 0]


def _crosses(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.cross(b - a, c - a)


def _normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    crosses = _crosses(vertices, faces)
    return crosses / np.linalg.norm(crosses, axis=1, keepdims=True)
