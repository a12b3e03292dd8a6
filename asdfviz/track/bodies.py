"""What a tracker needs to know of a part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from asdfviz.datatypes import Mesh, Part
from asdfviz.track.viewpoint_model import ViewpointModel


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """What a tracker needs to know of one part."""

    mesh: Mesh
    model: ViewpointModel
    color: UInt8[np.ndarray, 3]
    """Colour of the real piece (sRGB)."""

    @staticmethod
    def of(part: Part, model: ViewpointModel) -> Body:
        """The body of a part of an assembly."""
        return Body(part.mesh, model, part.color)

    @property
    def centred(self) -> Mesh:
        """The mesh about the middle of the part, which is where poses are optimised."""
        return Mesh(np.ascontiguousarray(self.mesh.vertices - self.model.centre), self.mesh.faces)
