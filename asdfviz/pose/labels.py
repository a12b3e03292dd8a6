"""The labels of a picture, computed from the poses that it shows: for training and for YOLO files.

Symmetric parts get the keypoints of their canonical pose: otherwise equal pictures would have
unequal labels, and the network would answer with their mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float32

from asdfviz.data.json_files import read_json
from asdfviz.data.scene_objects import SceneObject, assign_parts
from asdfviz.data.truth import STATES
from asdfviz.datatypes import KEYPOINTS, Assembly, Part
from asdfviz.errors import SequenceError
from asdfviz.geometry.camera import project
from asdfviz.geometry.sampling import hull_corners
from asdfviz.geometry.shapes import Depth, Intrinsics, Pixels, Points, Transform
from asdfviz.geometry.symmetry import canonical
from asdfviz.geometry.transforms import apply

Flags: TypeAlias = Float32[np.ndarray, "n"]

OCCLUSION_TOLERANCE = 0.006
"""Depth difference in metres from which a keypoint counts as hidden: the sensor's noise."""
SMALLEST_VISIBLE = 0.2
"""Objects of which less is seen are left out of label files; 0 to 1."""
_RASTER = 128
"""Pixels of the longer side of the picture in which a group's outlines are laid over one another."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledObject:
    """One object of a picture: a part, or the assembled parts of a state."""

    label: int
    """Output of the network: place in `joint_classes` of the assemblies trained."""
    outline: Float32[np.ndarray, "h 2"]
    """Convex hull of all projected vertices, hidden ones too, pixels. A box follows from it under
    any affine map exactly."""
    keypoints: Float32[np.ndarray, "17 3"]
    """x, y in pixels, and 0 not labelled (states), 1 hidden, 2 visible."""
    visible: float
    """Visible share of what the object covers, 0 to 1."""
    part: str | None
    """None for a state."""
    T_camera_part: Transform | None
    """Canonical pose; None for a state."""


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """An assembly and where its classes begin among the network's outputs."""

    assembly: Assembly
    first_label: int
    hulls: dict[str, Points]

    @classmethod
    def of(cls, assembly: Assembly, *, first_label: int = 0) -> Subject:
        """An assembly whose classes begin at `first_label`."""
        hulls = {name: hull_corners(part.mesh.vertices) for name, part in assembly.parts.items()}
        return cls(assembly, first_label, hulls)


@dataclass(frozen=True, slots=True)
class Group:
    """Parts in a picture that are joined as in a state."""

    state: str
    """State.name."""
    members: tuple[int, ...] | None
    """Places in the frame's list of objects; None: the state's attached parts, by name."""


def read_groups(folder: Path) -> dict[int, tuple[Group, ...]]:
    """Read states.json: the `groups` of a frame where it lists them, else its one `name`."""
    file = folder / STATES
    if not file.is_file():
        return {}
    frames: dict[int, tuple[Group, ...]] = {}
    for entry in read_json(file, error=SequenceError).entries():
        index = entry.get("frame").integer()
        name, groups = entry.find("name"), entry.find("groups")
        if groups is not None:
            frames[index] = tuple(
                Group(
                    state=group.get("name").text(),
                    members=tuple(place.integer() for place in group.get("gt").entries()),
                )
                for group in groups.entries()
            )
        elif name is not None:
            frames[index] = (Group(state=name.text(), members=None),)
    return frames


def part_of(assembly: Assembly, item: SceneObject) -> Part | None:
    """The part of an assembly that an object is; None for another thing."""
    parts = assembly.parts.values()
    return next((p for p in parts if item.obj_id in (p.name, p.obj_id)), None)


@dataclass(frozen=True, slots=True, eq=False)
class Labeller:
    """Makes the labels of one picture."""

    subject: Subject
    K: Intrinsics
    size_wh: tuple[int, int]
    depth: Depth | None
    smallest_visible: float

    def labels(
        self, objects: tuple[SceneObject, ...], groups: tuple[Group, ...]
    ) -> tuple[LabelledObject, ...]:
        """Label every part, and every group of joined parts, that is seen well enough."""
        parts = [part_of(self.subject.assembly, item) for item in objects]
        pairs = zip(parts, objects, strict=True)
        found = [self._part_label(part, item) for part, item in pairs if part is not None]
        found += [self._state_label(objects, group) for group in groups]
        return tuple(label for label in found if label is not None)

    def _label(self, name: str) -> int:
        return self.subject.first_label + self.subject.assembly.detector_classes.index(name)

    def _part_label(self, part: Part, item: SceneObject) -> LabelledObject | None:
        visible = 1.0 if item.visible is None else item.visible
        outline = self._outline(part.name, item.T_camera_object)
        if visible < self.smallest_visible or outline is None:
            return None
        T_camera_part = canonical(item.T_camera_object, part.symmetries)
        points = apply(T_camera_part, part.keypoints)
        pixels = project(points, self.K)
        flags = _visibility(points, pixels, self.size_wh, self.depth)
        return LabelledObject(
            label=self._label(part.detector_class),
            outline=outline,
            keypoints=np.concatenate([pixels, flags[:, None]], axis=1).astype(np.float32),
            visible=visible,
            part=part.name,
            T_camera_part=T_camera_part,
        )

    def _state_label(self, objects: tuple[SceneObject, ...], group: Group) -> LabelledObject | None:
        state = next((s for s in self.subject.assembly.states if s.name == group.state), None)
        if state is None or state.detector_class is None:
            return None
        if group.members is None:
            found, _ = assign_parts(objects, self.subject.assembly)
            members = [found[name] for name in state.attached if name in found]
        else:
            members = [objects[place] for place in group.members]
        if len(members) < len(state.attached):
            return None
        outlines: list[np.ndarray] = []
        for member in members:
            part = part_of(self.subject.assembly, member)
            outline = None if part is None else self._outline(part.name, member.T_camera_object)
            if outline is None:
                return None
            outlines.append(outline)
        shares = [1.0 if member.visible is None else member.visible for member in members]
        visible = _group_share(outlines, shares)
        if visible < self.smallest_visible:
            return None
        return LabelledObject(
            label=self._label(state.detector_class),
            outline=cv2.convexHull(np.concatenate(outlines))[:, 0].astype(np.float32),
            keypoints=np.zeros((KEYPOINTS, 3), np.float32),
            visible=visible,
            part=None,
            T_camera_part=None,
        )

    def _outline(self, name: str, T_camera_part: Transform) -> Float32[np.ndarray, "h 2"] | None:
        points = apply(T_camera_part, self.subject.hulls[name])
        if points[:, 2].min() < 0.01:
            return None
        pixels = project(points, self.K).astype(np.float32)
        return cv2.convexHull(pixels)[:, 0].astype(np.float32)


def _group_share(outlines: Sequence[Float32[np.ndarray, "_ 2"]], shares: Sequence[float]) -> float:
    """The visible share, 0 to 1, of what joined parts cover together; what they cover of each other counts.

    Seen pixels of all over those of the union, the hulls standing for the silhouettes in both, so that
    a part's holes nearly cancel: without anything before the group the share is 1 as it should be, and
    behind an occluder it comes out a little high where hulls interlock. As in a part's own share, what
    lies outside the picture is not seen.

    Args:
        outlines: convex hull of each part, pixels.
        shares: visible share of each.
    """
    corners = np.concatenate(outlines)
    low = corners.min(axis=0)
    scale = (_RASTER - 1) / max(float((corners.max(axis=0) - low).max()), 1e-6)
    union = np.zeros((_RASTER, _RASTER), np.uint8)
    seen = 0.0
    for outline, share in zip(outlines, shares, strict=True):
        covered = np.zeros_like(union)
        cv2.fillConvexPoly(covered, np.rint((outline - low) * scale).astype(np.int32), 1)
        seen += share * cv2.countNonZero(covered)
        union |= covered
    return min(1.0, seen / cv2.countNonZero(union))


def _visibility(
    points: Points, pixels: Pixels, size_wh: tuple[int, int], depth: Depth | None
) -> Flags:
    """Tell visible keypoints (2) from hidden ones (1): outside the picture or behind something."""
    u, v = np.round(np.nan_to_num(pixels, nan=-1e6)).astype(int).T
    inside = (u >= 0) & (v >= 0) & (u < size_wh[0]) & (v < size_wh[1])
    measured = np.zeros(len(points))
    if depth is not None:
        measured[inside] = depth[v[inside], u[inside]]
    in_front = (measured > 0) & (measured < points[:, 2] - OCCLUSION_TOLERANCE)
    return np.where(inside & ~in_front, 2.0, 1.0).astype(np.float32)
