"""Training crops cut out of scenes: parts and groups on their tables, in hands and under shadows, and
places in which a part is still missing.

Crops that are rendered on their own never repeat, but lack what scenes have around a part. A share of
these beside them brings the network nearer to what it is asked in use.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Int64, UInt8

from asdfviz.data.cameras import read_scene_cameras
from asdfviz.data.images import read_rgb
from asdfviz.data.scene_files import find_scene_files
from asdfviz.data.scene_objects import SceneObject, read_scene_objects
from asdfviz.data.truth import unchecked_frames
from asdfviz.datatypes import Assembly, Part
from asdfviz.detector.crop_classes import (
    CropClass,
    class_name,
    group_name,
    group_states,
    state_spans,
)
from asdfviz.detector.crop_cut import CROP_PIXELS, crop_camera, cut
from asdfviz.errors import SequenceError
from asdfviz.geometry.shapes import Intrinsics, Rgb, Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.pose.labels import Group, part_of, read_groups
from asdfviz.synth.tensors import to_tensor
from asdfviz.train.crop_config import CropTrainConfig
from asdfviz.train.crop_data import LEAST_VISIBLE, CropMaker, Crops
from asdfviz.train.crop_places import EmptyPlaces, box_of, held_bases
from asdfviz.train.crop_pool import CropPool
from asdfviz.train.crop_scenes import STORED_PIXELS
from asdfviz.train.dataset import shown_subject, subjects_of


class _Shown(NamedTuple):
    """What a crop is cut about."""

    label: int
    state: int
    """-1 for a part."""
    name: int
    """As in `Crops`."""
    T_camera_part: Transform


class _Cut(NamedTuple):
    shown: _Shown
    picture: UInt8[np.ndarray, "s s 3"]
    T_crop_part: Transform
    focal: float


class FoundCrops:
    """The crops of some scenes, drawn class by class."""

    def __init__(self, crops: Crops, *, nothing: int) -> None:
        """Take crops; `nothing` is the name that those of empty places bear."""
        self.crops = crops
        is_empty = crops.names.cpu().numpy() == nothing
        labels = crops.labels.cpu().numpy()
        self._shown = _rows_by_label(labels, ~is_empty)
        self._empty = _rows_by_label(labels, is_empty)
        self._every = np.flatnonzero(~is_empty)

    def draw(
        self, labels: Int64[np.ndarray, "n"], *, rng: np.random.Generator, empty: float = 0.0
    ) -> Crops:
        """A random crop of each of these classes, of any where the scenes show none.

        Args:
            labels: the classes.
            rng: draws.
            empty: how often an empty place of the class is taken instead, where scenes have any.
        """
        rows: list[int] = []
        for label in labels.tolist():
            of_class = self._shown.get(label, self._every)
            if label in self._empty and rng.random() < empty:
                of_class = self._empty[label]
            rows.append(int(rng.choice(of_class)))
        return self.crops.taken(torch.tensor(rows, dtype=torch.int64))


def mixed(
    pool: CropPool,
    found: FoundCrops | None,
    *,
    maker: CropMaker,
    config: CropTrainConfig,
    rng: np.random.Generator,
) -> Crops:
    """The crops of a step: rendered ones, and some cut out of scenes if there are any."""
    if found is None:
        return pool.draw(config.batch, rng=rng)
    cut_out = round(config.scene_share * config.batch)
    labels = maker.labels(rng, cut_out)
    empty = 0.0 if config.teach == "poses" else config.empty_share  # they have no pose
    crops = found.draw(labels, rng=rng, empty=empty).to(config.device)
    return Crops.joined([pool.draw(config.batch - cut_out, rng=rng), crops])


def found_crops(
    folders: Sequence[Path],
    assemblies: Sequence[Assembly],
    classes: Sequence[CropClass],
    *,
    pixels: int = STORED_PIXELS,
    only_groups: bool = False,
) -> FoundCrops:
    """Cut out every part that is seen well enough, what is joined to every base part, and the places
    about it that are still empty, as far as all parts of the frame were checked.

    Args:
        folders: scene folders with truth; with several assemblies, sequence.json says whose.
        assemblies: in the order of the network's.
        classes: `crop_classes` of them.
        pixels: side of a crop.
        only_groups: leave parts and empty places out.

    Raises:
        SequenceError: a folder is broken, shows none of the assemblies, or nothing is seen in any.
    """
    subjects = subjects_of(assemblies)
    number = {c.name: place for place, c in enumerate(classes)}
    spans = state_spans(group_states(classes))
    cuts: list[_Cut] = []
    places = {subject.assembly.name: EmptyPlaces(subject) for subject in subjects}
    for folder in folders:
        assembly = shown_subject(folder, subjects).assembly
        files, cameras = find_scene_files(folder), read_scene_cameras(folder / "scene_camera.json")
        objects, groups = read_scene_objects(folder), read_groups(folder)
        unchecked = unchecked_frames(folder)
        for index in files.rgb:
            if index not in objects or index not in cameras:
                continue
            held = groups.get(index, ())
            parts = [part_of(assembly, item) for item in objects[index]]
            shown = [*_shown(assembly, number, spans, objects[index], parts, held)]
            shown = [one for one in shown if one.state >= 0 or not only_groups]
            if not shown:
                continue
            rgb, K = read_rgb(files.rgb[index]), cameras[index].K
            size_wh = (rgb.shape[1], rgb.shape[0])
            empty = places[assembly.name].find(objects[index], parts, held, K=K, size_wh=size_wh)
            for part, T in () if only_groups or index in unchecked else empty:
                label = number[class_name(assembly, part)]
                shown.append(_Shown(label, -1, len(classes), T))
            for one in shown:
                made = _cut(rgb, K, one, classes, pixels=pixels)
                cuts += [] if made is None else [made]
    if not cuts:
        raise SequenceError(f"no part is seen in {[str(f) for f in folders]}")
    return FoundCrops(_crops(cuts), nothing=len(classes))


def _shown(
    assembly: Assembly,
    number: Mapping[str, int],
    spans: Mapping[str, slice],
    objects: Sequence[SceneObject],
    parts: Sequence[Part | None],
    groups: Sequence[Group],
) -> Iterator[_Shown]:
    """The parts of a frame, and the groups that hold a base part.

    Args:
        assembly: whose.
        number: of every class.
        spans: where the states of each group lie.
        objects: of the frame.
        parts: of the assembly that they are; None: another thing.
        groups: of the frame.
    """
    for part, item in zip(parts, objects, strict=True):
        if part is not None and _is_seen(item):
            label = number[class_name(assembly, part)]
            yield _Shown(label, -1, label, item.T_camera_object)
    states = [s.name for s in assembly.states]
    group = group_name(assembly)
    for held, place in held_bases(assembly, parts, groups):
        if _is_seen(objects[place]):
            state = spans[group].start + states.index(held)
            yield _Shown(number[group], state, -1, objects[place].T_camera_object)


def _rows_by_label(
    labels: Int64[np.ndarray, "n"], wanted: Bool[np.ndarray, "n"]
) -> dict[int, Int64[np.ndarray, "k"]]:
    return {int(c): np.flatnonzero(wanted & (labels == c)) for c in np.unique(labels[wanted])}


def _is_seen(item: SceneObject) -> bool:
    return item.visible is None or item.visible >= LEAST_VISIBLE


def _cut(
    rgb: Rgb, K: Intrinsics, shown: _Shown, classes: Sequence[CropClass], *, pixels: int
) -> _Cut | None:
    """The crop about a true box, wider than the network's input so that it can be rolled."""
    box = box_of(classes[shown.label].corners, shown.T_camera_part, K)
    if box is None:
        return None
    camera = crop_camera(box, K, side=round(CROP_PIXELS * pixels / STORED_PIXELS))
    K_stored = camera.K.copy()
    K_stored[:2, 2] = (pixels - 1) / 2
    picture = cut(rgb, replace(camera, K=K_stored), K, size=(pixels, pixels))
    T_crop_camera = transform_from(camera.R_camera_crop.T, np.zeros(3))
    return _Cut(shown, picture, T_crop_camera @ shown.T_camera_part, float(camera.K[0, 0]))


def _crops(cuts: Sequence[_Cut]) -> Crops:
    labels = torch.tensor([c.shown.label for c in cuts])
    states = torch.tensor([c.shown.state for c in cuts])
    side = cuts[0].picture.shape[0]
    pictures = np.zeros((len(cuts), 4, side, side), np.uint8)
    for row, one in zip(pictures, cuts, strict=True):
        row[:3] = one.picture.transpose(2, 0, 1)
    return Crops(
        torch.from_numpy(pictures),  # pyright: ignore[reportUnknownMemberType] - untyped in torch
        labels,
        states,
        torch.tensor([c.shown.name for c in cuts]),
        to_tensor(np.stack([c.T_crop_part for c in cuts]).astype(np.float32), "cpu"),
        torch.tensor([c.focal for c in cuts], dtype=torch.float32),
        torch.zeros(len(cuts), dtype=torch.bool),
    )
