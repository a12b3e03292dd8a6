"""The nouns that every room of the package speaks: cameras, frames, assemblies, predictions, truth.

All are frozen, with read-only arrays. Metres, radians, seconds; the camera frame has OpenCV's axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64, UInt8

from asdfviz.geometry.boxes import BoxMask, middle_of_points
from asdfviz.geometry.shapes import (
    AllScores,
    Box,
    Depth,
    Distortion,
    Faces,
    Intrinsics,
    Pixels,
    Points,
    Rgb,
    Scores,
    Transform,
    Vector,
)
from asdfviz.geometry.symmetry import Symmetries

Stage = Literal["pnp", "crop", "refined", "group", "tracked", "annotated", "truth", "csv"]
"""The last step that touched a pose; "csv": it was read from results that do not say so."""

KEYPOINTS = 17
"""Keypoints a part, as in the paper."""


@dataclass(frozen=True, slots=True, eq=False)
class Camera:
    """A pinhole camera; `distortion` is what a reader still has to undo."""

    K: Intrinsics
    width: int
    height: int
    distortion: Distortion | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One RGB-D picture, undistorted. There is no truth in it."""

    index: int
    """Number in the file name, not the place in the sequence."""
    time: float
    rgb: Rgb
    depth: Depth | None
    """Planar depth in metres, 0 = none; None where the sequence has no depth for this frame."""
    camera: Camera


@dataclass(frozen=True, eq=False)
class Mesh:
    """A triangle mesh in the part's CAD frame, metres."""

    vertices: Points
    faces: Faces

    @cached_property
    def middle(self) -> Vector:
        """Of its box; kept, because methods ask for it many times a frame."""
        return middle_of_points(self.vertices)


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One physical piece. Its frame is the CAD frame, never recentred."""

    name: str
    mesh: Mesh
    keypoints: Float64[np.ndarray, "17 3"]
    symmetries: Symmetries
    diameter: float
    color: UInt8[np.ndarray, 3]
    """Colour of the real piece (sRGB), used to render it and to train."""
    detector_class: str
    """Repeated parts (HS_Pin, HS_Pin-Copy) share one."""
    obj_id: int | None = None
    """Number in BOP datasets that use integers."""

    @property
    def middle(self) -> Vector:
        """Of the mesh's box, metres; distances are taken there: the CAD origin may lie far outside."""
        return self.mesh.middle


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """The freedom that a joined part keeps: T_base_part = motion @ T_base_part of the state."""

    kind: Literal["prismatic", "revolute", "cylindrical", "ball"]
    axis: Vector
    """Unit vector in the base frame (any for a ball)."""
    origin: Vector
    """A point on the axis, or the ball's centre; base frame, metres."""
    slide: tuple[float, float] = (0.0, 0.0)
    turn: tuple[float, float] = (0.0, 0.0)
    """Travel along the axis, metres, and turn about it, radians, about the nominal pose."""
    link: str = ""
    """Joints of one link are geared together: each is as far along its ranges as the others."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """A step of the assembly, or an error that can follow one."""

    index: int
    """Place in Assembly.states."""
    name: str
    T_base_part: Mapping[str, Transform]
    """Nominal pose of every joined part in the base part's frame; the base part is in it, as identity."""
    is_error: bool = False
    after: int | None = None
    """Of an error state: index of the last correctly completed state."""
    detector_class: str | None = None
    """None where the state looks like the base part alone (state 0)."""
    joints: Mapping[str, Joint] = field(default_factory=dict[str, Joint])

    @property
    def attached(self) -> tuple[str, ...]:
        """Names of the joined parts, base part first."""
        return tuple(self.T_base_part)

    @property
    def completed(self) -> int:
        """Index of the last correctly completed state, which an error does not change."""
        return self.index if self.after is None else self.after


@dataclass(frozen=True, slots=True, eq=False)
class Assembly:
    """Parts, states and what may follow what. Correct states come first, in order, then errors."""

    name: str
    title: str
    base: str
    parts: Mapping[str, Part]
    states: tuple[State, ...]
    transitions: frozenset[tuple[int, int]]
    """Pairs (from, to) of state indices; staying is always allowed."""
    detector_classes: tuple[str, ...]
    """Names in the order of the network's outputs: parts, then states."""
    path: str
    """The assembly.yaml it came from."""

    @property
    def steps(self) -> tuple[State, ...]:
        """The correct states, in order."""
        return tuple(s for s in self.states if not s.is_error)

    @property
    def errors(self) -> tuple[State, ...]:
        """The error states."""
        return tuple(s for s in self.states if s.is_error)


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
    """One box of the network with its keypoints, in pixels; `label` is the class of a part or state."""

    label: str
    box_xyxy: Box
    keypoints_px: Pixels
    keypoint_scores: Scores
    score: float
    mask: BoxMask | None = None
    class_scores: Mapping[str, float] = field(default_factory=dict[str, float])
    """Of all classes that may be in its place; run files keep neither these nor the mask."""


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """Where one part is, and how surely, from 0 to 1."""

    part: str
    T_camera_part: Transform
    score: float
    stage: Stage


@dataclass(frozen=True, slots=True, eq=False)
class StateEstimate:
    """How probable each state is, and the terms that it was fused from."""

    probabilities: Scores
    """One a state of the assembly, errors included; sums to 1."""
    terms: Mapping[str, Scores] = field(default_factory=dict[str, Scores])
    unfolded: Mapping[str, AllScores] = field(default_factory=dict[str, AllScores])
    """Terms as the model took them where it has states of its own, half-done ones: these come last. From
    them the states can be decoded anew (`asdfviz.state.offline`)."""

    @property
    def index(self) -> int:
        """Index of the most probable state (an error state has an index of its own)."""
        return int(np.argmax(self.probabilities))


@dataclass(frozen=True, slots=True, eq=False)
class FramePrediction:
    """What a method says of one frame. A part that was not found is absent."""

    frame_index: int
    poses: Mapping[str, PoseEstimate]
    state: StateEstimate | None
    detections: tuple[Detection, ...] = ()
    runtime: Mapping[str, float] = field(default_factory=dict[str, float])
    """Seconds by stage, "total" among them; methods with a detector call its stage "detect"."""
    not_found: Mapping[str, Transform] = field(default_factory=dict[str, Transform])
    """What a csv has in place of a pose for parts that were not found, its translation zero. No poses:
    only the GBOT authors' rules count them."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameTruth:
    """What is known of one frame. Reaches nobody but the evaluator, the views and run()'s initial pose."""

    frame_index: int
    T_camera_part: Mapping[str, Transform]
    state: int | None
    """Index of the last correctly completed state, also while an error is there."""
    is_error: bool | None = None
    attached: tuple[str, ...] | None = None
    visible: Mapping[str, float] = field(default_factory=dict[str, float])
    """Visible share of each part's outline, 0 to 1; a part may be missing where it is not known."""
    error: str | None = None
    """Name of the error state while `is_error`; None where nobody said which."""
    lists_parts: bool = False
    """Whether a part without a pose is not there even where no part has one, as by `[]` in scene_gt.json."""
    unchecked: tuple[str, ...] = ()
    """Parts without a pose that may be there all the same, as nobody looked: no pose of them is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """A method's result on a sequence: the artefact that is saved and compared."""

    method: str
    config: Mapping[str, object]
    sequence: str
    assembly: str
    """Absolute paths of the scene folder and of the assembly.yaml."""
    version: str
    predictions: tuple[FramePrediction, ...]
    hashes: Mapping[str, str] = field(default_factory=dict[str, str])
    """SHA-256 of what went in: "assembly", "weights", "sequence"."""
    initial: Literal["none", "first_frame_truth"] = "none"
    says_states: bool = True
    """False for what can say none, as a csv or a tracker of poses alone: then no state is wrong."""


@runtime_checkable
class Sequence(Protocol):
    """RGB-D frames, read when asked for."""

    @property
    def name(self) -> str:
        """Short name for lists and file names."""
        ...

    @property
    def path(self) -> str:
        """Absolute path of the scene folder."""
        ...

    @property
    def assembly(self) -> Assembly | None:
        """What is being put together; None where nobody said."""
        ...

    @property
    def camera(self) -> Camera:
        """The camera of the first frame, undistorted."""
        ...

    @property
    def frame_indices(self) -> tuple[int, ...]:
        """Number of each frame, in order of place."""
        ...

    def __len__(self) -> int: ...
    def __getitem__(self, place: int) -> Frame:
        """The frame at a place, 0 to len - 1. Raises SequenceError for a bad or missing image."""
        ...

    def truth(self, place: int) -> FrameTruth | None:
        """The one door to the truth; None where there is none."""
        ...
