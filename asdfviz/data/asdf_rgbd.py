"""Reads the ASDF authors' training export: colour and depth in one PNG, YOLO-pose labels beside it.

    images/NNNNNN.png   16 bit, 4 channels: blue, green, red (8-bit value times 256), depth in millimetres
    labels/NNNNNN.txt   a row an object: class, box centre and size, 17 times x y v, all normalised
    *.yaml              `names`, the class of each number; there or in a folder above
    camera.json         there or in a folder above
    states.json         in our own exports: the states, also where no row tells them

Images and labels are paired by name. Labels give the state; their keypoints give no pose, and one
solved from them would be an estimate, so the truth holds none. Without a yaml the classes are the
assembly's detector classes, which is the authors' order: parts by name, then states.
"""

from __future__ import annotations

from pathlib import Path
from typing import cast

import cv2
import numpy as np
import yaml

from asdfviz.data.asdf_states import NO_BOX, STATE_LABEL, state_truth
from asdfviz.data.folder_sequence import SceneReaders
from asdfviz.data.images import ImageKindError, RawDepth, kind_of, read_stored
from asdfviz.data.scene_files import SceneFiles, numbered_files
from asdfviz.data.truth import STATES, StateTruth, read_states
from asdfviz.data.yaml_fields import load_yaml
from asdfviz.datatypes import KEYPOINTS, Assembly, FrameTruth
from asdfviz.errors import SequenceError
from asdfviz.geometry.shapes import Rgb

_IMAGES, _LABELS = "images", "labels"
_COLUMNS = 5 + 3 * KEYPOINTS
FOLDERS_ABOVE = 3
"""Folders above the scene in which camera.json and the yaml are looked for."""


def is_rgbd_scene(folder: Path) -> bool:
    """Whether a folder is one split of the authors' export."""
    return (folder / _IMAGES).is_dir() and (folder / _LABELS).is_dir()


def find_rgbd_files(folder: Path) -> SceneFiles:
    """List the images, each as colour and as depth, and check that every one has its labels.

    Raises:
        SequenceError: there is no image, or an image or a label lacks its partner.
    """
    images, odd = numbered_files(folder / _IMAGES, (".png",))
    labels, _ = numbered_files(folder / _LABELS, (".txt",))
    if not images:
        raise SequenceError(f"{folder / _IMAGES} holds no frames; expected 000000.png ...")
    for index, path in images.items():
        if index not in labels:
            expected = folder / _LABELS / f"{path.stem}.txt"
            raise SequenceError(f"{path} has no labels: expected {expected}")
    for index, path in labels.items():
        if index not in images:
            expected = folder / _IMAGES / f"{path.stem}.png"
            raise SequenceError(f"{path} has no image: expected {expected}")
    return SceneFiles(rgb=images, depth=images, ignored=odd)


def read_rgbd_color(path: Path) -> Rgb:
    """Read the colour of a 16-bit four-channel image; the low byte of every value is empty.

    Raises:
        SequenceError: it is broken, or of another bit depth or number of channels.
    """
    bgr = (_four_channels(path)[..., :3] >> 8).astype(np.uint8)
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def read_rgbd_depth(path: Path) -> RawDepth:
    """Read the depth of a 16-bit four-channel image, in millimetres.

    Raises:
        SequenceError: as `read_rgbd_color`.
    """
    return np.ascontiguousarray(_four_channels(path)[..., 3])


def read_rgbd_truth(folder: Path, assembly: Assembly) -> dict[int, FrameTruth]:
    """Read the state of every image from states.json if given, else from its labels; poses are not known.

    Raises:
        SequenceError: with the file and line; a class that has no name, a state that is unknown,
            a row of a wrong length, two states in one image.
    """
    if (folder / STATES).is_file():
        said = read_states(folder, assembly)
        return {index: _known_state(index, said[index]) for index in sorted(said)}
    names = class_names(folder, assembly)
    labels, _ = numbered_files(folder / _LABELS, (".txt",))
    truth: dict[int, FrameTruth] = {}
    for index, path in labels.items():
        truth[index] = _known_state(index, _state_of_rows(path, names, assembly))
    return truth


def _known_state(index: int, said: StateTruth) -> FrameTruth:
    return FrameTruth(index, {}, said.state, said.is_error, said.attached, error=said.error)


def class_names(folder: Path, assembly: Assembly) -> tuple[str, ...]:
    """The name of every class number: from the nearest yaml with `names`, else the assembly's own.

    Raises:
        SequenceError: a yaml cannot be read, or several beside each other have names.
    """
    for place in (folder, *list(folder.parents)[:FOLDERS_ABOVE]):
        paths = sorted((*place.glob("*.yaml"), *place.glob("*.yml")))
        found = {path: names for path in paths if (names := _names_in(path))}
        own = {path: names for path, names in found.items() if path.stem == folder.parent.name}
        found = own or found
        if len(found) > 1:
            raise SequenceError(
                f"{place} holds several files with class names: "
                f"{', '.join(path.name for path in found)}; keep the one of {folder}"
            )
        if found:
            return next(iter(found.values()))
    return assembly.detector_classes


def _names_in(path: Path) -> tuple[str, ...]:
    try:
        content: object = load_yaml(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise SequenceError(f"{path} cannot be read as YAML: {error}") from error
    if not isinstance(content, dict):
        return ()
    names = cast(dict[object, object], content).get("names")
    if isinstance(names, list):
        return tuple(str(name) for name in cast(list[object], names))
    if not isinstance(names, dict):
        return ()
    numbered = cast(dict[object, object], names)
    if set(numbered) != set(range(len(numbered))):
        raise SequenceError(f"{path}: names must be numbered 0 to {len(numbered) - 1} without gaps")
    return tuple(str(numbered[number]) for number in range(len(numbered)))


def _four_channels(path: Path) -> np.ndarray:
    image = read_stored(path)
    if image.dtype != np.uint16 or image.ndim != 3 or image.shape[2] != 4:
        raise ImageKindError(
            path,
            f"is {kind_of(image)}; expected a 16-bit PNG with 4 channels (blue, green, red, depth)",
        )
    return image


def _state_of_rows(path: Path, names: tuple[str, ...], assembly: Assembly) -> StateTruth:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise SequenceError(f"{path} cannot be read: {error}") from error
    found: list[StateTruth] = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        where = f"{path} line {number}"
        name = _class_of(line, names, where)
        known = {state.detector_class for state in assembly.states}
        if name in known or (name not in assembly.parts and STATE_LABEL.fullmatch(name)):
            found.append(state_truth(name, assembly, where=where))
    if len(found) > 1:
        raise SequenceError(f"{path} has {len(found)} rows of states; an image shows one state")
    return found[0] if found else NO_BOX


def _class_of(line: str, names: tuple[str, ...], where: str) -> str:
    cells = line.split()
    try:
        values = np.array(cells, dtype=np.float64)
    except ValueError as error:
        raise SequenceError(f"{where}: expected {_COLUMNS} numbers, got '{line[:60]}'") from error
    if len(values) != _COLUMNS or not np.isfinite(values).all():
        raise SequenceError(
            f"{where}: {len(values)} columns, expected {_COLUMNS} finite numbers: class, box, "
            f"{KEYPOINTS} times x y v"
        )
    number = int(values[0])
    if number != values[0] or not 0 <= number < len(names):
        raise SequenceError(
            f"{where}: class {cells[0]} has no name; the classes are 0 to {len(names) - 1} "
            f"({names[0]} to {names[-1]})"
        )
    return names[number]


READERS = SceneReaders(rgb=read_rgbd_color, depth=read_rgbd_depth, truth=read_rgbd_truth)
