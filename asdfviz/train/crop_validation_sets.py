"""What a crop network is judged on while it is trained: crops of the training's own kind, and parts
in scenes."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
import torch

from asdfviz.datatypes import Assembly
from asdfviz.detector.crop_classes import CropClass, class_name
from asdfviz.detector.crop_cut import CROP_PIXELS, crop_camera, cut, metric_side
from asdfviz.detector.crop_network import STRIDE
from asdfviz.geometry.rotation_grid import quaternion_of
from asdfviz.geometry.transforms import apply_to_point
from asdfviz.synth.tensors import to_tensor
from asdfviz.train.crop_config import CropTrainConfig
from asdfviz.train.crop_data import CropMaker, Crops
from asdfviz.train.crop_views import SHIFT, ZOOM, ViewMaker, Views, measured_sizes
from asdfviz.train.dataset import load_images

SEED = 987_654_321
"""Kept apart from those of training."""
BATCH = 128
_Row = tuple[np.ndarray, int, np.ndarray, np.ndarray, float]
"""Picture, class, rotation, place and size of a part in a scene."""


def validation_sets(
    config: CropTrainConfig, maker: CropMaker, views: ViewMaker, assemblies: Sequence[Assembly]
) -> dict[str, list[Views]]:
    """Views of crops that are never trained on, and of parts in scenes.

    Args:
        config: of the run; its folder keeps the crops, so that every sitting is judged on the same.
        maker: of crops.
        views: shows them.
        assemblies: that the network knows.

    Raises:
        SequenceError: a scene folder is broken or shows none of the assemblies.
    """
    count = config.validation_crops * len(maker.classes)
    file = config.output / "validation_crops.npz"
    if not file.is_file():
        rng = np.random.default_rng([SEED, config.seed])
        maker.make(count, rng=rng).save(file)
    crops, rng = Crops.load(file), np.random.default_rng(SEED)
    starts = range(0, len(crops), BATCH)
    rows = [torch.arange(i, min(i + BATCH, len(crops))) for i in starts]
    on_device = [crops.taken(part).to(config.device) for part in rows]
    sets = {"crops": [views.views(part, rng=rng) for part in on_device]}
    if config.validation:
        scenes = scene_views(config.validation, assemblies, maker.classes)
        sets["scenes"] = [_on(part, config.device) for part in scenes]
    return sets


def scene_views(
    folders: Iterable[Path],
    assemblies: Sequence[Assembly],
    classes: Sequence[CropClass],
) -> list[Views]:
    """Crops of the parts in scenes, cut as in use, with boxes as wrong as a detector's.

    Raises:
        SequenceError: a folder is broken or shows none of the assemblies.
    """
    rng = np.random.default_rng(0)
    number = {c.name: place for place, c in enumerate(classes)}
    by_name = {a.name: a for a in assemblies}
    rows: list[_Row] = []
    for image in load_images(tuple(folders), tuple(assemblies), image_size=1280):
        assembly = by_name[image.assembly]
        for item in image.objects:
            if item.part is None or item.T_camera_part is None:
                continue
            label = number[class_name(assembly, assembly.parts[item.part])]
            low, high = item.outline.min(0), item.outline.max(0)
            side = float((high - low).max())
            shift = SHIFT * side * np.clip(rng.normal(size=2), -2, 2)
            half = (high - low) / 2 * np.exp(ZOOM * np.clip(rng.normal(), -2, 2))
            middle = (low + high) / 2 + shift
            box = np.concatenate([middle - half, middle + half]).astype(np.float64)
            camera = crop_camera(box, image.K)
            R_crop_part = camera.R_camera_crop.T @ item.T_camera_part[:3, :3]
            seen = camera.R_camera_crop.T @ apply_to_point(
                item.T_camera_part, classes[label].middle
            )
            focal = camera.K[0, 0]
            place = [*(seen[:2] / seen[2] * focal / (CROP_PIXELS / 2)),
                     np.log(focal * classes[label].diameter / (seen[2] * CROP_PIXELS))]  # fmt: skip
            picture = cut(image.rgb, camera, image.K)
            distance = seen[2] * camera.R_camera_crop[2, 2] * measured_sizes(rng, 1)[0]
            size = metric_side(camera, float(distance))
            rows.append((picture, label, quaternion_of(R_crop_part), np.array(place), size))
    return [_views(rows[i : i + 128]) for i in range(0, len(rows), 128)]


def _views(rows: Sequence[_Row]) -> Views:
    pictures = to_tensor(np.stack([r[0] for r in rows]), "cpu").permute(0, 3, 1, 2)
    cells = CROP_PIXELS // STRIDE
    return Views(
        pictures.float() / 255 - 0.5,
        torch.tensor([r[1] for r in rows]),
        torch.full((len(rows),), -1),
        torch.tensor([r[1] for r in rows]),
        to_tensor(np.stack([r[2] for r in rows]), "cpu", dtype=torch.float32),
        to_tensor(np.stack([r[3] for r in rows]), "cpu", dtype=torch.float32),
        torch.full((len(rows), cells, cells), torch.nan),
        torch.tensor([r[4] for r in rows], dtype=torch.float32),
    )


def _on(rows: Views, device: str) -> Views:
    """The same on a device."""
    return Views(*(getattr(rows, f.name).to(device) for f in dataclasses.fields(rows)))
