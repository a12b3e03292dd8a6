"""What a synthetic picture consists of, as plain data: placed meshes, flat grounds, lights, a camera.

A layout (scenes, packs, sequences) writes it; the G-buffer and the shading read it. World frame: z is
up, the table's top is z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Camera
from asdfviz.geometry.shapes import Transform, Vector

Kind: TypeAlias = Literal["part", "distractor", "hand"]


@dataclass(frozen=True, slots=True, eq=False)
class Finish:
    """How a surface looks. Colours are linear RGB, 0 to 1."""

    color: Vector
    roughness: float = 0.5
    mottling: float = 0.1
    """Strength of random brightness over the surface."""
    layer_axis: int = 2
    """Axis of the mesh along which printed layers lie."""
    layer_height: float = 0.0006
    """Metres."""
    layer_depth: float = 0.0
    """Tilt of the normal by the layers, radians; 0 for none."""
    translucency: float = 0.0
    """How far light wraps round the surface, as in skin."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """One mesh in the scene."""

    mesh: int
    """Index in the MeshBank."""
    T_world_mesh: Transform
    """Affine for distractors, rigid otherwise."""
    finish: Finish
    kind: Kind
    name: str = ""
    """Of a part: its name in the assembly."""
    truth: bool = False
    """Whether its pose belongs to the truth (a duplicate of a part does, a distractor does not)."""

    def __post_init__(self) -> None:
        # It would vanish from the picture without a word, and the truth would name no place.
        assert np.isfinite(self.T_world_mesh).all(), f"a {self.kind} stands nowhere"


@dataclass(frozen=True, slots=True, eq=False)
class Photo:
    """A photo that lies on a ground, its middle at the maps' origin."""

    file: str
    width: float
    """Metres that its longer side shows."""
    gain: Vector
    """Factors on its colours, linear RGB."""


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """A horizontal textured plane, whole or cut to a convex outline."""

    height: float
    """z in metres."""
    edges: Float64[np.ndarray, "k 3"]
    """Half planes a x + b y <= c that bound it; none for an endless plane."""
    macro: tuple[str, int]
    """Kind and variant of the large map."""
    micro: tuple[str, int]
    colors: Float64[np.ndarray, "3 3"]
    """The three colours that the map mixes, linear RGB."""
    angle: float
    """Rotation of the maps, radians."""
    offset: tuple[float, float]
    """Shift of the maps, metres."""
    bump: float = 1.0
    """Factor on the map's slopes."""
    roughness: float = 0.85
    circle: tuple[float, float, float] | None = None
    """Centre x, y and radius of a round outline, metres."""
    scale: float = 1.0
    """Factor on the size of the large map."""
    photo: Photo | None = None
    """Shown instead of the maps and colours; `colors` are then its mean."""


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """A round area light that looks at the scene's centre."""

    position: Vector
    radius: float
    """Metres."""
    color: Vector
    """Irradiance that it gives at the world's origin, linear RGB."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything that one picture shows."""

    camera: Camera
    T_camera_world: Transform
    placed: tuple[Placed, ...]
    grounds: tuple[Ground, ...]
    """From the topmost to the lowest; a ray sees the first that it hits."""
    lights: tuple[Light, ...]
    sky: Vector
    """Ambient light from above, linear RGB."""
    tint: Vector = field(default_factory=lambda: np.zeros(3))
    """Direction (world) and strength by which the ambient light varies."""
    target: Vector = field(default_factory=lambda: np.zeros(3))
    """Where the shadow maps look at, world."""
    reach: float = 0.6
    """Radius around `target` within which shadows fall, metres."""
