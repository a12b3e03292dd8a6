"""Finds and reads what the GBOT data holds of one assembly: description, meshes, keypoints, poses.

Both the folder of derived data (assemblies.json, full/, light/, keypoints17/) and the dataset as
its authors publish it (<assembly>/model/..., yolov8pose/models/...) are understood, by file name.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, cast

import numpy as np
import trimesh
from jaxtyping import UInt8
from manifold3d import Error, Manifold
from manifold3d import Mesh as ManifoldMesh

from asdfviz.data.meshes import default_keypoints, load_any, read_mesh
from asdfviz.datatypes import KEYPOINTS, Mesh
from asdfviz.errors import AssemblyError
from asdfviz.geometry.shapes import Points, Transform
from asdfviz.geometry.transforms import is_rigid, orthonormalized

MAX_FACES = 3000
"""Larger meshes are decimated: trackers and renderers need no more."""
_DESCRIPTION = Path(__file__).with_name("gbot_assemblies.json")
_PICTURES = {"rgb", "depth", "test", "images", "labels"}


@dataclass(frozen=True)
class GbotSource:
    """A folder with GBOT data."""

    folder: Path

    @cached_property
    def description(self) -> Mapping[str, Any]:
        """States and relative poses by assembly: the folder's own, else the packaged ones."""
        own = self.folder / "assemblies.json"
        path = own if own.is_file() else _DESCRIPTION
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise AssemblyError(f"{path} cannot be read: {error}") from error
        if not isinstance(content, dict):
            raise AssemblyError(f"{path} is not a mapping of assemblies")
        return cast(Mapping[str, Any], content)

    @cached_property
    def files(self) -> Mapping[str, Path]:
        """Every mesh, keypoint and description file below the folder, by its name."""
        found: dict[str, Path] = {}
        for root, folders, names in os.walk(self.folder):
            # The dataset holds hundreds of thousands of pictures, and no mesh beside them.
            folders[:] = sorted(f for f in folders if f not in _PICTURES)
            for name in sorted(names):
                if name.endswith((".ply", "_kps.txt")):
                    found.setdefault(name, Path(root) / name)
        return found

    def has_mesh(self, part: str) -> bool:
        """Whether a mesh of the part is there, full or downsampled."""
        return any(name in self.files for name in _mesh_names(part))

    def mesh(self, part: str) -> Mesh:
        """The part's mesh in metres: the full one with at most 3000 faces, else the light one.

        Raises:
            AssemblyError: neither file is there, or it is no mesh.
        """
        for name in _mesh_names(part):
            if name in self.files:
                return decimated(read_mesh(self.files[name], unit="mm", part=part))
        raise AssemblyError(
            f"part '{part}': {self.folder} holds neither {' nor '.join(_mesh_names(part))}"
        )

    def color(self, part: str) -> UInt8[np.ndarray, 3] | None:
        """Median of the mesh's vertex colours, kept off pure black and white; None if it has none."""
        path = next(self.files[n] for n in _mesh_names(part) if n in self.files)
        visual = load_any(path).visual
        if visual.kind != "vertex":
            return None
        median = np.median(np.asarray(visual.vertex_colors)[:, :3], axis=0)
        return np.clip(median, 25, 235).astype(np.uint8)

    def keypoints(self, part: str, mesh: Mesh) -> Points:
        """The authors' 17 keypoints (metres), or farthest points where there is no such file.

        Raises:
            AssemblyError: the file does not hold 17 rows of three numbers.
        """
        path = self.files.get(f"{part}_kps.txt")
        if path is None:
            return default_keypoints(mesh)
        try:
            points = np.loadtxt(path, dtype=np.float64, ndmin=2)
        except (OSError, ValueError) as error:
            raise AssemblyError(f"keypoints {path} cannot be read: {error}") from error
        if points.shape != (KEYPOINTS, 3):
            raise AssemblyError(
                f"keypoints {path} have shape {points.shape}, expected ({KEYPOINTS}, 3)"
            )
        return points

    def relative_poses(self, assembly_folder: str) -> dict[tuple[str, str], Transform]:
        """T_parent_child (metres) of the authors' assembly_state.json by (parent, child).

        Empty where the folder has no such file.

        Raises:
            AssemblyError: the file is not in the authors' form.
        """
        found = sorted(self.folder.glob(f"**/{assembly_folder}/model/**/assembly_state.json"))
        if not found:
            return {}
        try:
            steps = json.loads(found[0].read_text(encoding="utf-8"))
            return {_bodies(step): _relative_pose(step) for step in steps.values()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise AssemblyError(
                f"{found[0]}: expected states with referenced_bodies, R (9) and T (3): {error!r}"
            ) from error


def _bodies(step: Mapping[str, Any]) -> tuple[str, str]:
    parent, child = step["referenced_bodies"]
    return str(parent), str(child)


def _relative_pose(step: Mapping[str, Any]) -> Transform:
    T_parent_child = np.eye(4)
    T_parent_child[:3, :3] = np.asarray(step["R"], dtype=float).reshape(3, 3)
    T_parent_child[:3, 3] = np.asarray(step["T"], dtype=float).reshape(3)
    if not is_rigid(T_parent_child, tolerance=1e-2):
        raise ValueError(f"R of {step['referenced_bodies']} is not a rotation")
    return orthonormalized(T_parent_child)


def _mesh_names(part: str) -> tuple[str, str]:
    return f"{part}.ply", f"{part}_downsampled.ply"


def decimated(mesh: Mesh) -> Mesh:
    """The mesh with at most MAX_FACES faces, within about 0.3 mm of what it was.

    Quadric collapse alone (Garland and Heckbert, 1997) tears the fine threads of these meshes off
    by centimetres, so flat and dense regions are merged first, which bounds the error.
    """
    if len(mesh.faces) <= MAX_FACES:
        return mesh
    # In millimetres: both simplifiers have thresholds of their own that expect such numbers.
    # Copies of a corner are welded, or the surface would come apart at every seam.
    surface = trimesh.Trimesh(mesh.vertices * 1e3, mesh.faces, process=True)
    solid = Manifold(
        ManifoldMesh(surface.vertices.astype(np.float32), surface.faces.astype(np.uint32))
    )
    # A mesh with open edges has no volume to keep; it goes on as it is.
    if solid.status() == Error.NoError:
        merged: Any = solid.simplify(0.2).to_mesh()
        surface = trimesh.Trimesh(merged.vert_properties[:, :3], merged.tri_verts, process=False)
    if len(surface.faces) > MAX_FACES:
        surface = surface.simplify_quadric_decimation(face_count=MAX_FACES, aggression=5)
    vertices = np.array(surface.vertices, dtype=np.float64) * 1e-3
    return Mesh(vertices, np.array(surface.faces, dtype=np.int32))
