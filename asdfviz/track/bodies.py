"""What a tracker needs to know of a part."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import UInt8

from asdfviz.datatypes import Mesh, Part
from asdfviz.geometry.shapes import Vector
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.track.viewpoint_model import ViewpointModel


@dataclass(frozen=True, eq=False)
class Body:
    """What a tracker needs to know of one part; no slots, so that what follows from it is kept."""

    mesh: Mesh
    model: ViewpointModel
    color: UInt8[np.ndarray, 3]
    """Colour of the real piece (sRGB)."""
    balance: Vector
    """Centre of its mass, part frame, metres: turned about it, a part covers about the same of the
    picture, as it would not about the middle of its box."""
    symmetries: Symmetries = field(default_factory=Symmetries)
    """Poses that look the same, about the middle of the part."""

    @staticmethod
    def of(part: Part, model: ViewpointModel) -> Body:
        """The body of a part of an assembly."""
        symmetries = part.symmetries.about(model.centre)
        return Body(part.mesh, model, part.color, centre_of_mass(part.mesh), symmetries)

    @cached_property
    def centred(self) -> Mesh:
        """The mesh about the middle of the part, which is where poses are optimised."""
        return Mesh(np.ascontiguousarray(self.mesh.vertices - self.model.centre), self.mesh.faces)

    @cached_property
    def reach(self) -> float:
        """How far it reaches from its middle, metres."""
        return float(np.linalg.norm(self.centred.vertices, axis=1).max())


def centre_of_mass(mesh: Mesh) -> Vector:
    """Of the solid, or of the surface where the mesh encloses none, mesh frame, metres."""
    as_it_is = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    merged = as_it_is.copy()
    merged.merge_vertices()  # files may repeat them; bodies that touch are closed only before this
    is_closed = as_it_is.is_volume or merged.is_volume
    centre = as_it_is.center_mass if is_closed else as_it_is.centroid
    return np.asarray(centre, np.float64)
