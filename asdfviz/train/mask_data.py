"""Pictures with instance masks, and network inputs drawn from them, for training a mask branch.

Masks are BOP's mask_visib/: the pixels that show a part, as the renderer knows them, so whatever
stands in front is cut out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
import torch
from jaxtyping import Float32, UInt8
from torch import Tensor

from asdfviz.data.cameras import read_scene_cameras
from asdfviz.data.images import read_rgb, read_stored
from asdfviz.data.scene_files import find_scene_files
from asdfviz.data.scene_objects import SceneObject, read_scene_objects
from asdfviz.datatypes import KEYPOINTS, Assembly
from asdfviz.detector.assigner import Targets
from asdfviz.errors import SequenceError
from asdfviz.geometry.shapes import Intrinsics, Rgb
from asdfviz.pose.labels import SMALLEST_VISIBLE, LabelledObject, Labeller
from asdfviz.train.augment import Labels
from asdfviz.train.dataset import LabelledImage, shown_subject, subjects_of
from asdfviz.train.packing import AugmentConfig, Packer
from asdfviz.train.patches import cut_input

MASKS = "mask_visib"
MOST_OBJECTS = 255
OwnerMap: TypeAlias = UInt8[np.ndarray, "h w"]
"""Of every pixel 1 + the place of the object that it shows, 0 for anything else."""


@dataclass(frozen=True, slots=True, eq=False)
class MaskImage:
    """A picture whose parts have masks."""

    picture: LabelledImage
    """Its objects are the parts alone, and each one's label is its place among them."""
    labels: Labels
    """Output of the detector that each object belongs to."""
    owners: OwnerMap


@dataclass(frozen=True, slots=True, eq=False)
class MaskSample:
    """A network input; boxes in network coordinates (first pixel's centre at 0.5)."""

    rgb: Rgb
    labels: Labels
    boxes: Float32[np.ndarray, "m 4"]
    places: UInt8[np.ndarray, "m"]
    """What stands in `owners` for each object."""
    owners: OwnerMap


@dataclass(frozen=True, slots=True, eq=False)
class MaskBatch:
    """One step's inputs and labels."""

    images: UInt8[Tensor, "b h w 3"]
    targets: Targets
    places: UInt8[Tensor, "b m"]
    owners: UInt8[Tensor, "b h w"]

    def to(self, device: str) -> MaskBatch:
        """The same batch on a torch device."""
        targets = self.targets
        moved = Targets(
            labels=targets.labels.to(device),
            boxes=targets.boxes.to(device),
            keypoints=targets.keypoints.to(device),
            present=targets.present.to(device),
        )
        return MaskBatch(
            self.images.to(device), moved, self.places.to(device), self.owners.to(device)
        )


def load_mask_images(
    folders: Sequence[Path], assemblies: Sequence[Assembly]
) -> tuple[MaskImage, ...]:
    """Read every frame of the scenes that shows a part.

    Args:
        folders: scene folders; with several assemblies, each one's sequence.json says whose.
        assemblies: in the order of the network's outputs.

    Raises:
        SequenceError: a file is missing or broken, there are no masks, or no part is seen.
    """
    subjects = subjects_of(assemblies)
    images: list[MaskImage] = []
    for folder in folders:
        if not (folder / MASKS).is_dir():
            raise SequenceError(
                f"{folder} has no {MASKS}/: masks are written by `asdfviz synth packs --masks`"
            )
        subject = shown_subject(folder, subjects)
        cameras = read_scene_cameras(folder / "scene_camera.json")
        objects = read_scene_objects(folder)
        for index, file in find_scene_files(folder).rgb.items():
            if index not in objects or index not in cameras:
                continue
            rgb, K = read_rgb(file), cameras[index].K
            size_wh = (rgb.shape[1], rgb.shape[0])
            labeller = Labeller(subject, K, size_wh, None, SMALLEST_VISIBLE)
            image = _labelled(folder, index, objects[index], rgb, K, labeller)
            if len(image.labels):
                images.append(image)
    if not images:
        raise SequenceError(f"no part is to be seen in {[str(f) for f in folders]}")
    return tuple(images)


def _labelled(
    folder: Path,
    index: int,
    objects: Sequence[SceneObject],
    rgb: Rgb,
    K: Intrinsics,
    labeller: Labeller,
) -> MaskImage:
    owners = np.zeros(rgb.shape[:2], np.uint8)
    found: list[LabelledObject] = []
    labels: list[int] = []
    for k, item in enumerate(objects):
        for label in labeller.labels((item,), ()):
            mask = read_stored(folder / MASKS / f"{index:06d}_{k:06d}.png")
            if len(found) == MOST_OBJECTS or mask.shape != owners.shape:
                raise SequenceError(
                    f"{folder}: frame {index} has more than {MOST_OBJECTS} parts, or masks of "
                    "another size than the picture"
                )
            owners[mask > 0] = len(found) + 1
            labels.append(label.label)
            found.append(replace(label, label=len(found)))
    name = f"{folder.name}/{index:06d}"
    picture = LabelledImage(name, labeller.subject.assembly.name, rgb, K, tuple(found))
    return MaskImage(picture, np.array(labels, np.int64), owners)


def draw(
    image: MaskImage,
    rng: np.random.Generator,
    *,
    width: int,
    height: int,
    config: AugmentConfig,
) -> MaskSample:
    """Return the whole picture rolled, zoomed, shifted and in other colours.

    Args:
        image: what to show.
        rng: all chance comes from it.
        width: of the input, pixels.
        height: of the input, pixels.
        config: how much to change.
    """
    packer = Packer([image.picture], side=width, config=config)
    plan = packer.frame(rng, width=width, height=height, spread=1.0)
    H, seen = plan.patches[0].H, plan.marks
    owners = cv2.warpAffine(image.owners, H[:2], (width, height), flags=cv2.INTER_NEAREST)
    return MaskSample(
        rgb=cut_input(packer.images, plan).rgb,
        labels=image.labels[seen.labels],
        boxes=seen.boxes,
        places=(seen.labels + 1).astype(np.uint8),
        owners=np.asarray(owners, np.uint8),
    )


def collate_masks(samples: Sequence[MaskSample]) -> MaskBatch:
    """Stack samples of one size, labels padded to the longest list."""
    count, most = len(samples), max(1, *(len(s.labels) for s in samples))
    labels = np.zeros((count, most), np.int64)
    boxes = np.zeros((count, most, 4), np.float32)
    places = np.zeros((count, most), np.uint8)
    present = np.zeros((count, most), bool)
    for i, sample in enumerate(samples):
        n = len(sample.labels)
        labels[i, :n], boxes[i, :n], places[i, :n] = sample.labels, sample.boxes, sample.places
        present[i, :n] = True
    targets = Targets(
        labels=torch.as_tensor(labels),
        boxes=torch.as_tensor(boxes),
        keypoints=torch.zeros(count, most, KEYPOINTS, 3),
        present=torch.as_tensor(present),
    )
    images = torch.as_tensor(np.stack([s.rgb for s in samples]))
    owners = torch.as_tensor(np.stack([s.owners for s in samples]))
    return MaskBatch(images, targets, torch.as_tensor(places), owners)
