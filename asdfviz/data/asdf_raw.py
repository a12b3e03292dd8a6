"""Reads the ASDF authors' raw renderings: one camera of one scene, colour, depth and state boxes.

    Camera_*/Images/NNNNNN.png                            8-bit colour
    Camera_*/depth_images/NNNNNN.png                      16-bit depth in millimetres, 1 or 3 equal channels
    Camera_*/state_seg_maps/state_bounding_boxes.json     a list by frame number: {} or {"label", ...}
    camera.json                                           there or in a folder above

Images are paired by name. scene_gt.json beside them, where there is one, gives the poses.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from asdfviz.data.asdf_states import NO_BOX, state_truth
from asdfviz.data.folder_sequence import SceneReaders
from asdfviz.data.images import ImageKindError, RawDepth, kind_of, read_stored
from asdfviz.data.json_files import Json, read_json
from asdfviz.data.scene_files import SceneFiles, numbered_files
from asdfviz.data.truth import STATES, StateTruth, read_truth
from asdfviz.datatypes import Assembly, FrameTruth
from asdfviz.errors import SequenceError
from asdfviz.geometry.shapes import Rgb

_COLOUR, _DEPTH = "Images", "depth_images"
BOXES = Path("state_seg_maps") / "state_bounding_boxes.json"
_BOX_FIELDS = ("middle_x_norm", "middle_y_norm", "width_norm", "height_norm")


def is_raw_scene(folder: Path) -> bool:
    """Whether a folder holds the images of one camera as the authors' renderer wrote them."""
    return (folder / BOXES).is_file() or (folder / _COLOUR).is_dir()


def raw_scenes_below(folder: Path) -> tuple[Path, ...]:
    """The cameras up to three levels below a folder, for a hint which one to open."""
    patterns = ("/".join(["*"] * depth) + f"/{_COLOUR}" for depth in (1, 2, 3))
    return tuple(sorted(path.parent for pattern in patterns for path in folder.glob(pattern)))


def find_raw_files(folder: Path) -> SceneFiles:
    """Pair colour and depth by name.

    Raises:
        SequenceError: there is no image, or one lacks its partner.
    """
    rgb, odd_rgb = numbered_files(folder / _COLOUR, (".png",))
    depth, odd_depth = numbered_files(folder / _DEPTH, (".png",))
    if not rgb:
        raise SequenceError(
            f"{folder / _COLOUR} holds no frames; expected 000000.png, 000001.png ..."
        )
    files = SceneFiles(rgb=rgb, depth=depth, ignored=(*odd_rgb, *odd_depth))
    if files.rgb_without_depth:
        path = rgb[files.rgb_without_depth[0]]
        raise SequenceError(f"{path} has no depth image: expected {folder / _DEPTH / path.name}")
    if files.depth_without_rgb:
        path = depth[files.depth_without_rgb[0]]
        raise SequenceError(f"{path} has no colour image: expected {folder / _COLOUR / path.name}")
    return files


def read_raw_color(path: Path) -> Rgb:
    """Read an 8-bit colour image.

    Raises:
        SequenceError: it is broken, or of another bit depth or number of channels.
    """
    image = read_stored(path)
    if image.dtype != np.uint8 or image.ndim != 3:
        raise ImageKindError(
            path, f"is {kind_of(image)}; colour must be an 8-bit PNG with 3 channels"
        )
    return cv2.cvtColor(image[..., :3], cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def read_raw_millimetres(path: Path) -> RawDepth:
    """Read 16-bit depth; of three channels the first counts, as in the authors' scripts.

    Raises:
        SequenceError: it is broken, or of another bit depth or number of channels.
    """
    image = read_stored(path)
    if image.dtype != np.uint16 or (image.ndim == 3 and image.shape[2] != 3):
        raise ImageKindError(
            path,
            f"is {kind_of(image)}; depth must be a 16-bit PNG with 1 channel (or 3 equal ones), in "
            "millimetres",
        )
    return np.ascontiguousarray(image if image.ndim == 2 else image[..., 0])


def read_raw_truth(folder: Path, assembly: Assembly) -> dict[int, FrameTruth]:
    """Poses from scene_gt.json where it is there, states from the boxes (or states.json, if given).

    Raises:
        SequenceError: a file is broken, a frame has no entry, or a state is unknown.
    """
    truth = read_truth(folder, assembly)
    if (folder / STATES).is_file() or not (folder / BOXES).is_file():
        return truth
    states = _states_of_boxes(folder, assembly)
    blank = {i: FrameTruth(i, {}, None) for i in states}
    return {
        i: _with_state(frame, states[i]) if i in states else frame
        for i, frame in sorted({**blank, **truth}.items())
    }


def _with_state(frame: FrameTruth, said: StateTruth) -> FrameTruth:
    return replace(frame, state=said.state, is_error=said.is_error, error=said.error)


def _states_of_boxes(folder: Path, assembly: Assembly) -> dict[int, StateTruth]:
    """Read the list by frame number for the frames that have an image."""
    entries = read_json(folder / BOXES, error=SequenceError).entries()
    frames, _ = numbered_files(folder / _COLOUR, (".png",))
    missing = [index for index in frames if index >= len(entries)]
    if missing:
        raise SequenceError(
            f"{folder / BOXES} has {len(entries)} entries, so none for {frames[missing[0]].name}; "
            "entry n belongs to frame n"
        )
    return {index: _state_of_box(entries[index], assembly) for index in frames}


def _state_of_box(entry: Json, assembly: Assembly) -> StateTruth:
    if not entry.items():
        return NO_BOX
    for field in _BOX_FIELDS:
        entry.get(field).number()
    label = entry.get("label")
    return state_truth(label.text(), assembly, where=label.where)


READERS = SceneReaders(rgb=read_raw_color, depth=read_raw_millimetres, truth=read_raw_truth)
