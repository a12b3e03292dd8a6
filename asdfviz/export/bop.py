"""Writes a sequence and its truth as a BOP scene folder, with states.json beside.

    rgb/NNNNNN.*  depth/NNNNNN.png  camera.json  scene_camera.json  scene_gt.json
    scene_gt_info.json  states.json  models_info.json  sequence.json
    unchecked.json    parts without a pose that may be there all the same, as nobody looked
    model/assembly.yaml  model/parts/*.ply    of an assembly that does not ship with the program

`data.sequences.open_sequence` reads it back: poses and states are equal to what was written.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import cv2
import numpy as np

from asdfviz.data.assembly_writer import write_assembly
from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.data.encoding import encoded
from asdfviz.data.folder_sequence import FolderSequence
from asdfviz.data.image_files import image_kind
from asdfviz.data.images import read_raw_depth
from asdfviz.data.json_files import read_json
from asdfviz.data.prefetch import Prefetcher
from asdfviz.data.resources import MODEL, bundled_assemblies, way_to_assembly
from asdfviz.data.scene_files import RGB_SUFFIXES
from asdfviz.data.scene_objects import SCENE_GT_INFO
from asdfviz.data.truth import UNCHECKED
from asdfviz.datatypes import Assembly, Camera, Frame, FrameTruth, Sequence
from asdfviz.errors import SequenceError
from asdfviz.export.bop_content import (
    Ids,
    camera_content,
    models_info,
    scene_camera_entry,
    scene_gt,
    scene_gt_info,
    states,
    unchecked,
)
from asdfviz.export.gaps import says_what_is_there
from asdfviz.export.readable import readable_frames

_GENERATOR = "asdfviz export"
_SEQUENCE = "sequence.json"


def export_bop(
    sequence: Sequence,
    truth: Mapping[int, FrameTruth],
    folder: Path,
    *,
    ids: Ids = "names",
    gone: Collection[tuple[int, str]] = (),
    progress: Callable[[int, int], None] | None = None,
) -> dict[int, str]:
    """Write every frame of the sequence and the truth, by frame number, into a folder.

    Images are copied byte by byte, but a colour image whose lens was undone is written as a PNG
    of the undistorted one. An earlier export of the same sequence is replaced. A frame whose images
    cannot be read is left out, and so is its truth.

    Args:
        sequence: what to export; its own truth is not used.
        truth: poses and states by frame number; frames without an entry get none, and those with a
            state alone are in states.json alone: no poses would say that no part is there.
        folder: a new or empty folder, or an earlier export of this sequence.
        ids: what obj_id is, in the truth and in models_info.json.
        gone: frame numbers and parts that are not there, as a person said.
        progress: called with frames done and frames in all.

    Returns:
        Numbers of the frames that were left out, and why.

    Raises:
        SequenceError: the folder is in use by something else, no frame can be read, or truth is of
            a frame or a part that does not exist.
    """
    source = sequence.source if isinstance(sequence, Prefetcher) else sequence
    folder = folder.expanduser().resolve()
    check_target(folder, source)
    gt = scene_gt(truth, source, ids)  # refuses what does not fit before anything is written
    cameras: dict[str, object] = {}
    left_out: dict[int, str] = {}
    first: Camera | None = None
    scale = 1.0
    for frame in readable_frames(source, range(len(source)), left_out, progress=progress):
        if first is None:
            # Named first, so that an export that was cut off can be repeated in its folder.
            _write_json(folder / _SEQUENCE, about_export(source) | _with_model(source, folder))
        camera, scale = _write_images(source, frame, folder)
        cameras[str(frame.index)] = scene_camera_entry(camera, scale)
        first = first or camera
    for room in ("rgb", "depth"):
        remove_others(folder / room, cameras)
    _write_json(folder / "camera.json", camera_content(first or source.camera, scale))
    _write_json(folder / "scene_camera.json", cameras)
    known = {i: t for i, t in truth.items() if i not in left_out}
    parts = {part for _, part in gone} if source.assembly is None else source.assembly.parts
    posed = {i: t for i, t in known.items() if says_what_is_there(t, parts, gone)}
    _write_json(folder / "scene_gt.json", {str(i): gt[str(i)] for i in sorted(posed)})
    _write_or_remove(folder / SCENE_GT_INFO, scene_gt_info(posed))
    _write_or_remove(folder / UNCHECKED, unchecked(posed) or None)
    _write_json(folder / "states.json", states(known, source.assembly))
    if source.assembly is not None:
        _write_json(folder / "models_info.json", models_info(source.assembly, ids))
    return left_out


def _write_or_remove(file: Path, content: object | None) -> None:
    """Write what there is to say; where there is nothing, nothing may be left of an earlier export."""
    if content is None:
        file.unlink(missing_ok=True)
    else:
        _write_json(file, content)


def remove_others(folder: Path, kept: Collection[str]) -> None:
    """An earlier export may have had frames that are no longer there, or no longer known.

    Args:
        folder: of numbered images or labels.
        kept: the numbers that stay, as text without leading zeros.
    """
    for file in folder.glob("[0-9]*.*"):
        if str(int(file.stem) if file.stem.isdigit() else file.stem) not in kept:
            file.unlink()


def check_target(folder: Path, source: Sequence) -> None:
    """Refuse a folder that an export must not write into.

    Raises:
        SequenceError: it lies over the sequence, or holds anything but an earlier export of it.
    """
    origin = Path(source.path).resolve()
    if folder == origin or origin in folder.parents or folder in origin.parents:
        raise SequenceError(
            f"{folder} lies over the sequence {origin} itself; export into a folder apart from it"
        )
    if not folder.exists() or (folder.is_dir() and not any(folder.iterdir())):
        return
    if not folder.is_dir():
        raise SequenceError(f"{folder} is a file; give a folder to export into")
    if not _is_earlier_export(folder, source):
        raise SequenceError(
            f"{folder} is not empty and no earlier export of {source.name}; give a new folder"
        )


def _is_earlier_export(folder: Path, source: Sequence) -> bool:
    file = folder / _SEQUENCE
    if not file.is_file():
        return False
    about = read_json(file, error=SequenceError).items()
    generator, origin = about.get("generator"), about.get("source")
    return (
        generator is not None
        and generator.value == _GENERATOR
        and origin is not None
        and origin.value == source.path
    )


def about_export(source: Sequence) -> dict[str, object]:
    """sequence.json of an export: what it was made from."""
    about: dict[str, object] = {"generator": _GENERATOR, "source": source.path}
    if isinstance(source, FolderSequence):
        about["fps"] = source.fps
    if source.assembly is not None:
        about["assembly"] = _assembly_reference(source.assembly)
    return about


def _assembly_reference(assembly: Assembly) -> str:
    """The name of a bundled assembly, which means the same elsewhere; otherwise its path."""
    for name, file in bundled_assemblies().items():
        if Path(assembly.path).resolve() == file.resolve():
            return name
    return assembly.path


def _with_model(source: Sequence, folder: Path) -> dict[str, object]:
    """Copy an assembly of one's own into an export, so that it can be read elsewhere; what sequence.json
    says of it. Here the original is found first, with the weights beside it."""
    assembly = source.assembly
    if assembly is None or _assembly_reference(assembly) != assembly.path:
        return {}
    write_assembly(assembly, folder / MODEL)
    return {"assembly": assembly.name, **way_to_assembly(assembly, folder)}


def _write_images(source: Sequence, frame: Frame, folder: Path) -> tuple[Camera, float]:
    """Write one frame's images; return its camera and the millimetres per unit of its depth."""
    index = frame.index
    if not isinstance(source, FolderSequence) or not source.has_plain_files:
        return _write_decoded(frame, folder)
    rgb = source.files.rgb[index]
    if source.cameras[index].distortion is None:
        _write_one(folder, index, rgb.suffix.lower(), _bytes_of(rgb))
    else:
        _write_rgb(frame, folder)
    depth = source.files.depth.get(index)
    _write_depth(folder, index, None if depth is None else _as_png(depth))
    return source.camera_of(index), source.depth_scale(index)


def _write_decoded(frame: Frame, folder: Path) -> tuple[Camera, float]:
    """Write a frame that has no files of its own, its depth in the finest unit that holds it."""
    _write_rgb(frame, folder)
    scale = 1.0
    data: bytes | None = None
    if frame.depth is not None:
        depth_mm = frame.depth.astype(np.float64) * 1e3
        scale = 0.1 if depth_mm.max(initial=0.0) < 6500.0 else 1.0
        raw = np.rint(np.clip(depth_mm / scale, 0, 65535)).astype(np.uint16)
        data = encoded(raw)
    _write_depth(folder, frame.index, data)
    return frame.camera, scale


def _write_rgb(frame: Frame, folder: Path) -> None:
    bgr = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    _write_one(folder, frame.index, ".png", encoded(bgr))


def _write_one(folder: Path, index: int, suffix: str, data: bytes) -> None:
    """Write a colour image as the only one of its number: an earlier export may have another."""
    for other in RGB_SUFFIXES:
        if other != suffix:
            (folder / "rgb" / f"{index:06d}{other}").unlink(missing_ok=True)
    write_bytes(folder / "rgb" / f"{index:06d}{suffix}", data)


def _write_depth(folder: Path, index: int, data: bytes | None) -> None:
    """Write a depth image; without one, none may be left of an earlier export that had it."""
    file = folder / "depth" / f"{index:06d}.png"
    if data is None:
        file.unlink(missing_ok=True)
    else:
        write_bytes(file, data)


def _as_png(depth: Path) -> bytes:
    """A depth image as it lies on disk, or as a PNG of the same values where it is in another kind of file."""
    data = _bytes_of(depth)
    return data if image_kind(data) == "PNG" else encoded(read_raw_depth(depth))


def _bytes_of(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise SequenceError(f"{path} cannot be read: {error}") from error


def _write_json(path: Path, content: object) -> None:
    write_text(path, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
