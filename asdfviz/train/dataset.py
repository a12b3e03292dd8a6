"""Reads BOP scene folders with truth into memory as labelled pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64

from asdfviz.data.cameras import read_scene_cameras
from asdfviz.data.images import metric_depth, read_raw_depth, read_rgb
from asdfviz.data.json_files import read_json
from asdfviz.data.scene_files import find_scene_files
from asdfviz.data.scene_objects import read_scene_objects
from asdfviz.data.truth import UNCHECKED, unchecked_frames
from asdfviz.datatypes import KEYPOINTS, Assembly
from asdfviz.errors import SequenceError, counted
from asdfviz.geometry.camera import scaled_intrinsics
from asdfviz.geometry.shapes import Depth, Intrinsics, Rgb
from asdfviz.geometry.transforms import rotation_about
from asdfviz.pose.labels import Flags, LabelledObject, Labeller, Subject, read_groups
from asdfviz.pose.yolo_rows import flags_of_rows

SEQUENCE = "sequence.json"


@dataclass(frozen=True, slots=True, eq=False)
class Stacked:
    """The labels of all objects of a picture, in arrays that are moved together."""

    labels: Int64[np.ndarray, "m"]
    is_state: Bool[np.ndarray, "m"]
    outlines: Float32[np.ndarray, "p 2"]
    """Those of all objects behind one another, pixels."""
    starts: Int64[np.ndarray, "m"]
    """Where each begins."""
    keypoints: Float32[np.ndarray, "m 17 3"]
    rays: Float64[np.ndarray, "m 3 3"]
    """Rotation of the part as seen along the ray to it: what its picture shows, wherever it is;
    zeros for states."""
    middles: Float32[np.ndarray, "m 2"]
    """Of the outlines' boxes, pixels."""
    radii: Float32[np.ndarray, "m"]
    """How far the outlines reach from there, pixels."""

    def those(self, places: Int64[np.ndarray, "k"]) -> Stacked:
        """Of some of the objects, in this order."""
        ends = np.append(self.starts[1:], len(self.outlines))
        spans = [slice(a, b) for a, b in zip(self.starts[places], ends[places], strict=True)]
        counts = ends[places] - self.starts[places]
        return Stacked(
            labels=self.labels[places],
            is_state=self.is_state[places],
            outlines=np.concatenate([self.outlines[:0], *(self.outlines[s] for s in spans)]),
            starts=counts.cumsum() - counts,
            keypoints=self.keypoints[places],
            rays=self.rays[places],
            middles=self.middles[places],
            radii=self.radii[places],
        )

    @classmethod
    def of(cls, objects: Sequence[LabelledObject]) -> Stacked:
        """Stack the labels of a picture."""
        counts = np.array([len(o.outline) for o in objects], np.int64)
        flat = np.concatenate([np.zeros((0, 2), np.float32), *(o.outline for o in objects)])
        keypoints = np.array([o.keypoints for o in objects], np.float32)
        rays = np.array([_along_ray(o) for o in objects])
        middles = [(o.outline.min(0) + o.outline.max(0)) / 2 for o in objects]
        reaches = [
            np.linalg.norm(o.outline - middle, axis=1).max()
            for o, middle in zip(objects, middles, strict=True)
        ]
        return cls(
            labels=np.array([o.label for o in objects], np.int64),
            is_state=np.array([o.part is None for o in objects], bool),
            outlines=flat.astype(np.float32, copy=False),
            starts=counts.cumsum() - counts,
            keypoints=keypoints.reshape(-1, KEYPOINTS, 3),
            rays=rays.reshape(-1, 3, 3),
            middles=np.array(middles, np.float32).reshape(-1, 2),
            radii=np.array(reaches, np.float32),
        )


def _along_ray(item: LabelledObject) -> Float64[np.ndarray, "3 3"]:
    if item.T_camera_part is None:
        return np.zeros((3, 3))
    t = item.T_camera_part[:3, 3]
    ray = t / np.linalg.norm(t)
    axis = np.cross(ray, [0.0, 0.0, 1.0])
    length = float(np.linalg.norm(axis))
    turn = rotation_about(axis, np.arctan2(length, ray[2])) if length > 1e-9 else np.eye(3)
    return turn @ item.T_camera_part[:3, :3]


@dataclass(frozen=True, slots=True, eq=False)
class LabelledImage:
    """A picture with its labels."""

    name: str
    assembly: str
    """Whose parts it shows."""
    rgb: Rgb
    K: Intrinsics
    objects: tuple[LabelledObject, ...]
    stacked: Stacked = field(init=False)
    """The labels of `objects` once more, to be moved together."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "stacked", Stacked.of(self.objects))


def load_images(
    folders: Sequence[Path],
    assemblies: Sequence[Assembly],
    *,
    image_size: int,
    smallest_visible: float = 0.2,
    limit: int | None = None,
    share: slice = slice(None),
) -> tuple[LabelledImage, ...]:
    """Read every frame of the scenes that has truth of all its parts: what has no label is taught as nothing.

    Args:
        folders: scene folders.
        assemblies: give parts, symmetries and classes, in the order of the network's outputs. With
            one, folders without sequence.json show it; each other's says which.
        image_size: larger pictures are reduced to this longer side, pixels.
        smallest_visible: objects less visible than this are left out, 0 to 1.
        limit: read only this many frames, spread evenly; None means all.
        share: which of each folder's frames to read, where several processes share them.

    Raises:
        SequenceError: a file is missing or broken, names none of the assemblies, no frame has
            truth, or none shows a part.
    """
    subjects = subjects_of(assemblies)
    images: list[LabelledImage] = []
    found = 0
    for folder in folders:
        subject = shown_subject(folder, subjects)
        frames, known = _load_scene(folder, subject, image_size, smallest_visible, limit, share)
        images.extend(frames)
        found += known
    if not found:
        raise SequenceError(
            f"no frame with truth in {[str(f) for f in folders]}: "
            f"{told_unchecked(folders) or 'a training set has rgb/, scene_gt.json and scene_camera.json'}"
        )
    if share == slice(None) and not any(image.objects for image in images):
        names = ", ".join(s.assembly.name for s in subjects)
        raise SequenceError(f"no part of {names} is seen in {[str(f) for f in folders]}")
    return tuple(images)


def told_unchecked(folders: Sequence[Path]) -> str:
    """Say how many frames `load_images` leaves out as not all of their parts were checked; empty where none.

    Raises:
        SequenceError: a file is broken.
    """
    told: list[str] = []
    for folder in folders:
        unchecked = unchecked_frames(folder)
        if unchecked and (count := len(unchecked & read_scene_objects(folder).keys())):
            told.append(f"{counted(count, 'frame')} of {folder}")
    if not told:
        return ""
    return f"{', '.join(told)} left out, with parts that nobody checked ({UNCHECKED})"


def subjects_of(assemblies: Sequence[Assembly]) -> list[Subject]:
    """The assemblies of a network, in the order of its outputs."""
    subjects: list[Subject] = []
    first = 0
    for assembly in assemblies:
        subjects.append(Subject.of(assembly, first_label=first))
        first += len(assembly.detector_classes)
    return subjects


def shown_subject(folder: Path, subjects: Sequence[Subject]) -> Subject:
    """Which of the assemblies a scene folder shows: what its sequence.json says, or the only one.

    Raises:
        SequenceError: it names none of them, or nothing where there are several.
    """
    names = ", ".join(s.assembly.name for s in subjects)
    file = folder / SEQUENCE
    field = read_json(file, error=SequenceError).find("assembly") if file.is_file() else None
    if field is None:
        if len(subjects) == 1:
            return subjects[0]
        raise SequenceError(
            f"{folder} has no {SEQUENCE} that says which assembly it shows: {names}"
        )
    named = field.text()
    place = folder / named
    for subject in subjects:
        own = Path(subject.assembly.path).resolve()
        if named == subject.assembly.name or place.resolve() in (own, own.parent):
            return subject
    is_path = len(Path(named).parts) > 1
    if len(subjects) == 1 and is_path and not place.exists():
        return subjects[0]  # made elsewhere, where the assembly lay there
    raise SequenceError(
        f"{folder} is of {named}, not of one of the assemblies that are trained: {names}"
    )


def _load_scene(
    folder: Path,
    subject: Subject,
    image_size: int,
    smallest_visible: float,
    limit: int | None,
    share: slice,
) -> tuple[list[LabelledImage], int]:
    """The frames of a share, and how many frames with truth there are in all."""
    files = find_scene_files(folder)
    cameras = read_scene_cameras(folder / "scene_camera.json")
    objects = read_scene_objects(folder)
    groups = read_groups(folder)
    known = objects.keys() & cameras.keys() - unchecked_frames(folder)
    indices = [index for index in files.rgb if index in known]
    if limit is not None and len(indices) > limit:
        indices = [indices[int(i)] for i in np.linspace(0, len(indices) - 1, limit)]
    images: list[LabelledImage] = []
    for index in indices[share]:
        camera = cameras[index]
        depth: Depth | None = None
        if index in files.depth:
            depth = metric_depth(read_raw_depth(files.depth[index]), camera.depth_scale or 1.0)
        rgb = read_rgb(files.rgb[index])
        size_wh = (rgb.shape[1], rgb.shape[0])
        labeller = Labeller(subject, camera.K, size_wh, depth, smallest_visible)
        labels = labeller.labels(objects[index], groups.get(index, ()))
        file = folder / "labels" / f"{index:06d}.txt"
        image = LabelledImage(
            name=f"{folder.name}/{index:06d}",
            assembly=subject.assembly.name,
            rgb=rgb,
            K=camera.K,
            objects=_as_told(labels, file, size_wh, subject.first_label),
        )
        images.append(_reduced(image, image_size))
    return images, len(indices)


def _as_told(
    objects: tuple[LabelledObject, ...], file: Path, size_wh: tuple[int, int], first_label: int
) -> tuple[LabelledObject, ...]:
    """Take flags from a label file, if there is one: who drew the picture knew what hides what.

    Of a picture without depth nothing else tells, and a sensor's depth is noisy and has holes.
    """
    if not file.is_file():
        return objects
    told = flags_of_rows(
        file.read_text(encoding="utf-8", errors="replace"),
        objects,
        width=size_wh[0],
        height=size_wh[1],
        first_label=first_label,
    )
    return tuple(
        item if flags is None else _flagged(item, flags)
        for item, flags in zip(objects, told, strict=True)
    )


def _flagged(item: LabelledObject, flags: Flags) -> LabelledObject:
    keypoints = np.concatenate([item.keypoints[:, :2], flags[:, None]], axis=1)
    return replace(item, keypoints=keypoints.astype(np.float32, copy=False))


def _reduced(image: LabelledImage, image_size: int) -> LabelledImage:
    """Shrink a picture that is larger than the network will ever see."""
    height, width = image.rgb.shape[:2]
    ratio = image_size / max(height, width)
    if ratio >= 1:
        return image
    size = (round(width * ratio), round(height * ratio))
    scale = np.array([size[0] / width, size[1] / height], np.float32)
    small = cv2.resize(image.rgb, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    moved: list[LabelledObject] = []
    for item in image.objects:
        keypoints = item.keypoints.copy()
        keypoints[:, :2] = (keypoints[:, :2] + 0.5) * scale - 0.5
        outline = ((item.outline + 0.5) * scale - 0.5).astype(np.float32)
        moved.append(replace(item, outline=outline, keypoints=keypoints))
    K_small = scaled_intrinsics(image.K, float(scale[0]), float(scale[1]))
    return replace(image, rgb=small, K=K_small, objects=tuple(moved))
