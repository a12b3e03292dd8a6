"""Meshes prepared for rendering: normals that keep CAD edges sharp, and instances as one triangle list."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from typing import Any, cast

import numpy as np
import torch
from jaxtyping import Float32, Float64, Int64
from torch import Tensor

from asdfviz.datatypes import Mesh
from asdfviz.synth.memory import keep_freed_memory
from asdfviz.synth.tensors import invert, to_tensor, transform_each, unit

CREASE = np.deg2rad(34.0)
"""Faces that meet at a larger angle (radians) keep their own normals: no pillow shading."""


def corner_normals(mesh: Mesh, *, crease: float = CREASE) -> Float32[np.ndarray, "f 3 3"]:
    """Normal of each corner of each face: the area-weighted mean of its smooth neighbours.

    Corners at one place are neighbours even if the file repeats the vertex.
    """
    corner_vertex = _welded(mesh)[mesh.faces].reshape(-1)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    weighted = np.cross(b - a, c - a)
    unit = weighted / (np.linalg.norm(weighted, axis=1, keepdims=True) + 1e-20)
    weighted, unit = np.repeat(weighted, 3, axis=0), np.repeat(unit, 3, axis=0)
    total = _sums(corner_vertex, weighted)[corner_vertex]
    # Faces that lie within half a crease of their mean are all neighbours of each other.
    mean = total / (np.linalg.norm(total, axis=1, keepdims=True) + 1e-20)
    bent = np.zeros(len(total), bool)
    bent[corner_vertex[(mean * unit).sum(1) < np.cos(crease / 2)]] = True
    rest = bent[corner_vertex].nonzero()[0]
    if len(rest) > 0:
        total[rest] = _smooth_sums(corner_vertex[rest], weighted[rest], unit[rest], crease)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    normals = np.where(length > 1e-18, total / np.maximum(length, 1e-18), unit)
    return normals.reshape(-1, 3, 3).astype(np.float32)


@cache
def _lasting_normals(mesh: Mesh, *, crease: float) -> Float32[np.ndarray, "f 3 3"]:
    return corner_normals(mesh, crease=crease)


def _sums(
    group: Int64[np.ndarray, "n"], rows: Float64[np.ndarray, "n 3"], count: int = 0
) -> Float64[np.ndarray, "g 3"]:
    """Sum of the rows of each group."""
    columns = [np.bincount(group, weights=rows[:, k], minlength=count) for k in range(3)]
    return np.stack(columns, axis=1)


def _smooth_sums(
    corner_vertex: Int64[np.ndarray, "n"],
    weighted: Float64[np.ndarray, "n 3"],
    unit: Float64[np.ndarray, "n 3"],
    crease: float,
) -> Float64[np.ndarray, "n 3"]:
    """For each corner the sum over the corners at its vertex that meet it without a crease."""
    order = np.argsort(corner_vertex, kind="stable")
    sizes = np.bincount(corner_vertex)
    starts = np.cumsum(sizes) - sizes
    size_here = sizes[corner_vertex[order]]
    first = np.repeat(np.arange(len(order)), size_here)
    place = np.arange(len(first)) - np.repeat(np.cumsum(size_here) - size_here, size_here)
    second = starts[corner_vertex[order]][first] + place
    left, right = order[first], order[second]
    smooth = (unit[left] * unit[right]).sum(1) > np.cos(crease)
    return _sums(left[smooth], weighted[right[smooth]], len(order))


def _welded(mesh: Mesh) -> Int64[np.ndarray, "n"]:
    """Number of each vertex's place; those within a micrometre share it."""
    place = np.round(mesh.vertices * 1e6).astype(np.int64)
    return np.unique(_single(place), return_inverse=True)[1].reshape(-1)


def _single(rows: Int64[np.ndarray, "n k"]) -> Int64[np.ndarray, "n"]:
    """One integer for each row, in the rows' order: sorting rows takes numpy far longer."""
    rows = rows - rows.min(axis=0)
    number = np.zeros(len(rows), np.int64)
    for column in rows.T:
        number = number * (int(column.max()) + 1) + column
    return number


@dataclass(frozen=True, slots=True, eq=False)
class Triangles:
    """The triangles of a batch of images, ready for the rasteriser."""

    vertices: Float32[Tensor, "n 3"]
    """World frame of their image, metres."""
    local: Float32[Tensor, "n 3"]
    """The same in the mesh's own frame."""
    marks: Float32[Tensor, "n"]
    """Of the bank."""
    faces: Int64[Tensor, "f 3"]
    instance: Int64[Tensor, "f"]
    """Index of the placed mesh."""
    image: Int64[Tensor, "f"]
    vertex_instance: Int64[Tensor, "n"]
    vertex_image: Int64[Tensor, "n"]
    bank: MeshBank
    bank_face: Int64[Tensor, "f"]
    """Index of the triangle in the bank."""
    normal_maps: Float32[Tensor, "i 3 3"]
    """Takes normals (as rows, from the right) of each placed mesh into the world."""

    def normals_at(
        self, face: Int64[Tensor, "p"], weights: Float32[Tensor, "p 3"]
    ) -> Float32[Tensor, "p 3"]:
        """Unit normals in the world at points of triangles, given by weights of the corners."""
        corners = self.bank.normals.view(-1, 9).index_select(0, self.bank_face[face])
        local = (corners.view(-1, 3, 3) * weights[:, :, None]).sum(1)
        maps = torch.nn.functional.pad(self.normal_maps.transpose(1, 2), (0, 1))
        return unit(transform_each(maps, local, self.instance[face]).T)


@dataclass(frozen=True, slots=True, eq=False)
class MeshBank:
    """Many meshes behind one another in the memory of a device."""

    vertices: Float32[Tensor, "n 3"]
    faces: Int64[Tensor, "f 3"]
    normals: Float32[Tensor, "f 3 3"]
    vertex_ranges: Int64[Tensor, "m 2"]
    """Start and count."""
    face_ranges: Int64[Tensor, "m 2"]
    marks: Float32[Tensor, "n"]
    """What is drawn by a mark of its own at each vertex (nails); 0 where nothing is."""
    casters: MeshBank | None = None
    """The same meshes as they throw shadows, fewer triangles; None where they throw their own."""

    @classmethod
    def of(
        cls,
        meshes: Sequence[Mesh],
        *,
        device: str = "cpu",
        casters: Mapping[int, Mesh] | None = None,
        marks: Mapping[int, Float64[np.ndarray, "_"]] | None = None,
        rounded: Collection[int] = (),
        lasting: Collection[int] = (),
    ) -> MeshBank:
        """Upload meshes; their order gives the indices that `place` takes.

        Args:
            meshes: what is seen.
            device: where to.
            casters: simpler meshes, by index, that throw the shadows of those.
            marks: a number for each vertex, by index; 0 where a mesh has none.
            rounded: indices of meshes without an edge, however coarse their faces are.
            lasting: indices of meshes that every bank has: their normals are found once a process.
        """
        keep_freed_memory()

        def found(i: int, mesh: Mesh, crease: float) -> Float32[np.ndarray, "f 3 3"]:
            return (_lasting_normals if i in lasting else corner_normals)(mesh, crease=crease)

        normals = [
            found(i, mesh, np.pi if i in rounded else CREASE) for i, mesh in enumerate(meshes)
        ]
        bank = cls._upload(meshes, normals, device, marks or {})
        if not casters:
            return bank
        # What throws its own shadow has its normals already.
        normals = [
            found(i, casters[i], CREASE) if i in casters else n for i, n in enumerate(normals)
        ]
        throwing = [casters.get(i, mesh) for i, mesh in enumerate(meshes)]
        return replace(bank, casters=cls._upload(throwing, normals, device, {}))

    @classmethod
    def _upload(
        cls,
        meshes: Sequence[Mesh],
        normals: Sequence[Float32[np.ndarray, "_ 3 3"]],
        device: str,
        marks: Mapping[int, Float64[np.ndarray, "_"]],
    ) -> MeshBank:
        counts = np.array([[len(m.vertices), len(m.faces)] for m in meshes])
        starts = np.cumsum(counts, axis=0) - counts
        each = [marks.get(i, np.zeros(len(mesh.vertices))) for i, mesh in enumerate(meshes)]
        return cls(
            to_tensor(np.concatenate([m.vertices for m in meshes]), device, dtype=torch.float32),
            to_tensor(np.concatenate([m.faces for m in meshes]), device, dtype=torch.int64),
            to_tensor(np.concatenate(normals), device),
            to_tensor(np.stack([starts[:, 0], counts[:, 0]], axis=1), device),
            to_tensor(np.stack([starts[:, 1], counts[:, 1]], axis=1), device),
            to_tensor(np.concatenate(each), device, dtype=torch.float32),
        )

    def place(
        self,
        mesh: Int64[Tensor, "i"],
        T_world_mesh: Float64[Tensor, "i 4 4"],
        *,
        image: Int64[Tensor, "i"],
    ) -> Triangles:
        """Expand placed meshes into triangles.

        Args:
            mesh: index of each placed mesh.
            T_world_mesh: where it is; may be affine (distractors are stretched).
            image: the image it belongs to.
        """
        v_start, v_count = self.vertex_ranges[mesh].T
        f_start, f_count = self.face_ranges[mesh].T
        v_owner, v_source = _expand(v_start, v_count)
        f_owner, f_source = _expand(f_start, f_count)
        local = self.vertices.index_select(0, v_source)
        vertices = transform_each(T_world_mesh[:, :3].float(), local, v_owner).T.contiguous()
        offset = v_count.cumsum(0) - v_count
        faces = self.faces.index_select(0, f_source) + offset.index_select(0, f_owner)[:, None]
        # Normals turn with the inverse transpose, which is the rotation itself when rigid.
        normal_maps = invert(T_world_mesh[:, :3, :3]).float()
        return Triangles(
            vertices,
            local,
            self.marks.index_select(0, v_source),
            faces,
            f_owner,
            image[f_owner],
            v_owner,
            image[v_owner],
            self,
            f_source,
            normal_maps,
        )


def _expand(start: Tensor, count: Tensor) -> tuple[Tensor, Tensor]:
    """Owner and source index of each element of ranges laid behind one another."""
    owner = torch.repeat_interleave(count)
    place = torch.arange(len(owner), device=start.device) - (count.cumsum(0) - count)[owner]
    return owner, start[owner] + place


def thinned(mesh: Mesh, faces: int) -> Mesh:
    """The mesh with about so many faces; as it is where the simplifier is not installed."""
    if len(mesh.faces) <= faces or find_spec("fast_simplification") is None:
        return mesh
    import fast_simplification  # pyright: ignore[reportMissingTypeStubs] - it has none

    simplify = cast(Any, fast_simplification).simplify
    vertices, kept = simplify(mesh.vertices * 1e3, np.array(mesh.faces), target_count=faces, agg=3)
    return Mesh(np.asarray(vertices, np.float64) / 1e3, np.asarray(kept, np.int32))


def clustered(mesh: Mesh, cell: Float64[np.ndarray, "n"] | float) -> Mesh:
    """The mesh with one vertex for all within a cube, and without the faces that this flattens.

    Args:
        mesh: closed or not.
        cell: side of the cubes, metres; one for each vertex where they differ.
    """
    side = np.broadcast_to(np.asarray(cell, float), len(mesh.vertices))
    cube = np.floor(mesh.vertices / side[:, None]).astype(np.int64)
    sizes = np.unique(side, return_inverse=True)[1].reshape(-1)
    key = _single(np.column_stack([cube, sizes]))
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    faces = group.reshape(-1)[mesh.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, once = np.unique(_single(np.sort(faces, axis=1)), return_index=True)
    return Mesh(mesh.vertices[first], faces[np.sort(once)].astype(np.int32))
