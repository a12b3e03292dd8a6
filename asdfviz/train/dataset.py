"""Reads BOP scene folders with truth into memory and computes the detector's labels from the poses.

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
from scipy.spatial import ConvexHull  # pyright: ignore[reportMissingTypeStubs] - scipy has none

from asdfviz.data.cameras import read_scene_cameras
from asdfviz.data.images import metric_depth, read_raw_depth, read_rgb
from asdfviz.data.json_files import read_json
from asdfviz.data.scene_files import find_scene_files
from asdfviz.data.scene_objects import SceneObject, assign_parts, read_scene_objects
from asdfviz.data.truth import STATES
from asdfviz.datatypes import KEYPOINTS, Assembly, Part
from asdfviz.errors import SequenceError
from asdfviz.geometry.camera import project, scaled_intrinsics
from asdfviz.geometry.shapes import Depth, Intrinsics, Pixels, Points, Rgb, Transform
from asdfviz.geometry.symmetry import canonical
from asdfviz.geometry.transforms import apply

Flags: TypeAlias = Float32[np.ndarray, "n"]

OCCLUSION_TOLERANCE = 0.006
"""Depth difference in metres from which a keypoint counts as hidden: the sensor's noise."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledObject:
    """One object of a picture: a part, or the assembled parts of a state."""

    label: int
    """Place in Assembly.detector_classes."""
    outline: Float32[np.ndarray, "h 2"]
    """Convex hull of all projected vertices, hidden ones too, pixels. A box follows from it under
    any affine map exactly."""
    keypoints: Float32[np.ndarray, "17 3"]
    """x, y in pixels, and 0 not labelled (states), 1 hidden, 2 visible."""
    visible: float
    """Visible share of the outline, 0 to 1."""
    part: str | None
    """None for a state."""
    T_camera_part: Transform | None
    """Canonical pose; None for a state."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledImage:
    """A picture with its labels."""

    name: str
    rgb: Rgb
    K: Intrinsics
    objects: tuple[LabelledObject, ...]


def load_images(
    folders: Sequence[Path],
    assembly: Assembly,
    *,
    image_size: int,
    smallest_visible: float = 0.2,
    limit: int | None = None,
) -> tuple[LabelledImage, ...]:
    """Read every frame of the scenes that has truth.

    Args:
        folders: scene folders.
        assembly: gives parts, symmetries and classes.
        image_size: larger pictures are reduced to this longer side, pixels.
        smallest_visible: objects less visible than this are left out, 0 to 1.
        limit: read only this many frames, spread evenly; None means all.

    Raises:
        SequenceError: a file is missing or broken, or no frame has truth.
    """
    hulls = {name: _hull_points(part) for name, part in assembly.parts.items()}
    images: list[LabelledImage] = []
    for folder in folders:
        images.extend(_load_scene(folder, assembly, hulls, image_size, smallest_visible, limit))
    if not images:
        raise SequenceError(
            f"no frame with truth in {[str(f) for f in folders]}: a training set has rgb/, "
            "scene_gt.json and scene_camera.json"
        )
    return tuple(images)


def _load_scene(
    folder: Path,
    assembly: Assembly,
    hulls: dict[str, Points],
    image_size: int,
    smallest_visible: float,
    limit: int | None,
) -> list[LabelledImage]:
    files = find_scene_files(folder)
    cameras = read_scene_cameras(folder / "scene_camera.json")
    objects = read_scene_objects(folder)
    groups = _read_groups(folder)
    indices = [index for index in files.rgb if index in objects and index in cameras]
    if limit is not None and len(indices) > limit:
        indices = [indices[int(i)] for i in np.linspace(0, len(indices) - 1, limit)]
    images: list[LabelledImage] = []
    for index in indices:
        camera = cameras[index]
        depth: Depth | None = None
        if index in files.depth:
            depth = metric_depth(read_raw_depth(files.depth[index]), camera.depth_scale or 1.0)
        rgb = read_rgb(files.rgb[index])
        size_wh = (rgb.shape[1], rgb.shape[0])
        labeller = _Labeller(assembly, hulls, camera.K, size_wh, depth, smallest_visible)
        labels = labeller.labels(objects[index], groups.get(index, ()))
        images.append(_reduced(f"{folder.name}/{index:06d}", rgb, camera.K, labels, image_size))
    return images


@dataclass(frozen=True, slots=True)
class _Group:
    """Parts in a picture that are joined as in a state."""

    state: str
    """State.name."""
    members: tuple[int, ...] | None
    """Places in the frame's list of objects; None: the state's attached parts, by name."""


def _read_groups(folder: Path) -> dict[int, tuple[_Group, ...]]:
    """Read states.json: the `groups` of a frame where it lists them, else its one `name`."""
    file = folder / STATES
    if not file.is_file():
        return {}
    frames: dict[int, tuple[_Group, ...]] = {}
    for entry in read_json(file, error=SequenceError).entries():
        index = entry.get("frame").integer()
        name, groups = entry.find("name"), entry.find("groups")
        if groups is not None:
            frames[index] = tuple(
                _Group(
                    state=group.get("name").text(),
                    members=tuple(place.integer() for place in group.get("gt").entries()),
                )
                for group in groups.entries()
            )
        elif name is not None:
            frames[index] = (_Group(state=name.text(), members=None),)
    return frames


def _hull_points(part: Part) -> Points:
    vertices = part.mesh.vertices
    return vertices[ConvexHull(vertices).vertices]


@dataclass(frozen=True, slots=True, eq=False)
class _Labeller:
    assembly: Assembly
    hulls: dict[str, Points]
    K: Intrinsics
    size_wh: tuple[int, int]
    depth: Depth | None
    smallest_visible: float

    def labels(
        self, objects: tuple[SceneObject, ...], groups: tuple[_Group, ...]
    ) -> tuple[LabelledObject, ...]:
        parts = [self._part_of(item) for item in objects]
        pairs = zip(parts, objects, strict=True)
        found = [self._part_label(part, item) for part, item in pairs if part is not None]
        found += [self._state_label(objects, group) for group in groups]
        return tuple(label for label in found if label is not None)

    def _part_of(self, item: SceneObject) -> Part | None:
        parts = self.assembly.parts.values()
        return next((p for p in parts if item.obj_id in (p.name, p.obj_id)), None)

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
            label=self.assembly.detector_classes.index(part.detector_class),
            outline=outline,
            keypoints=np.concatenate([pixels, flags[:, None]], axis=1).astype(np.float32),
            visible=visible,
            part=part.name,
            T_camera_part=T_camera_part,
        )

    def _state_label(
        self, objects: tuple[SceneObject, ...], group: _Group
    ) -> LabelledObject | None:
        state = next((s for s in self.assembly.states if s.name == group.state), None)
        if state is None or state.detector_class is None:
            return None
        if group.members is None:
            found, _ = assign_parts(objects, self.assembly)
            members = [found[name] for name in state.attached if name in found]
        else:
            members = [objects[place] for place in group.members]
        shares = [1.0 if member.visible is None else member.visible for member in members]
        if len(members) < len(state.attached) or min(shares) < self.smallest_visible:
            return None
        outlines: list[np.ndarray] = []
        for member in members:
            part = self._part_of(member)
            outline = None if part is None else self._outline(part.name, member.T_camera_object)
            if outline is None:
                return None
            outlines.append(outline)
        return LabelledObject(
            label=self.assembly.detector_classes.index(state.detector_class),
            outline=cv2.convexHull(np.concatenate(outlines))[:, 0].astype(np.float32),
            keypoints=np.zeros((KEYPOINTS, 3), np.float32),
            visible=float(np.mean(shares)),
            part=None,
            T_camera_part=None,
        )

    def _outline(self, name: str, T_camera_part: Transform) -> Float32[np.ndarray, "h 2"] | None:
        points = apply(T_camera_part, self.hulls[name])
        if points[:, 2].min() < 0.01:
            return None
        pixels = project(points, self.K).astype(np.float32)
        return cv2.convexHull(pixels)[:, 0].astype(np.float32)


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


def _reduced(
    name: str,
    rgb: Rgb,
    K: Intrinsics,
    objects: tuple[LabelledObject, ...],
    image_size: int,
) -> LabelledImage:
    """Shrink a picture that is larger than the network will ever see."""
    height, width = rgb.shape[:2]
    ratio = image_size / max(height, width)
    if ratio >= 1:
        return LabelledImage(name=name, rgb=rgb, K=K, objects=objects)
    size = (round(width * ratio), round(height * ratio))
    scale = np.array([size[0] / width, size[1] / height], np.float32)
    small = cv2.resize(rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    moved: list[LabelledObject] = []
    for item in objects:
        keypoints = item.keypoints.copy()
        keypoints[:, :2] = (keypoints[:, :2] + 0.5) * scale - 0.5
        moved.append(
            LabelledObject(
                label=item.label,
                outline=((item.outline + 0.5) * scale - 0.5).astype(np.float32),
                keypoints=keypoints,
                visible=item.visible,
                part=item.part,
                T_camera_part=item.T_camera_part,
            )
        )
    K_small = scaled_intrinsics(K, float(scale[0]), float(scale[1]))
    return LabelledImage(name=name, rgb=small, K=K_small, objects=tuple(moved))
