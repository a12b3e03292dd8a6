"""Writes a sequence and its truth as a YOLO-pose data set, which public trainers and ASDF's scripts read.

    images/NNNNNN.png  labels/NNNNNN.txt  data.yaml (class names)  camera.json  sequence.json
    states.json

Images have 8 bits a channel, or are the 16-bit PNGs of the ASDF authors: blue, green, red (times
256) and depth in millimetres. `data.sequences.open_sequence` reads the latter back, the states from
states.json: a frame without a row of a state may be in one that is hidden, or that nobody knows.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import cv2
import numpy as np
import yaml

from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.data.encoding import encoded
from asdfviz.data.prefetch import Prefetcher
from asdfviz.data.scene_objects import SceneObject
from asdfviz.data.truth import STATES, fitting_errors
from asdfviz.datatypes import KEYPOINTS, Assembly, Frame, FrameTruth, Sequence, State
from asdfviz.errors import SequenceError, counted
from asdfviz.export.bop import about_export, check_target, remove_others
from asdfviz.export.bop_content import camera_content, states
from asdfviz.export.gaps import says_what_is_there, unchecked_frames
from asdfviz.export.readable import readable_frames
from asdfviz.pose.labels import SMALLEST_VISIBLE, Group, Labeller, Subject
from asdfviz.pose.yolo_rows import yolo_rows
from asdfviz.render.visibility import MissingShares


def export_yolo(
    sequence: Sequence,
    truth: Mapping[int, FrameTruth],
    folder: Path,
    *,
    with_depth: bool = False,
    gone: Collection[tuple[int, str]] = (),
    unchecked: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> dict[int, str]:
    """Write every frame that has truth of all its parts, with its labels, into a folder.

    Classes are the assembly's detector classes. Symmetric parts have the keypoints of their
    canonical pose, as in training. A frame whose images cannot be read is left out. An error has its
    own class where it is known which one it is, never that of the state that it hides. How much of a
    part is seen is rendered where the truth does not say it.

    Args:
        sequence: what to export; its own truth is not used.
        truth: poses and states by frame number.
        folder: a new or empty folder, or an earlier export of this sequence.
        with_depth: write the ASDF authors' images with depth in the fourth channel.
        gone: frame numbers and parts that are not there, as a person said.
        unchecked: also write frames with unchecked parts, which are background then.
        progress: called with frames done and frames in all.

    Returns:
        Numbers of the frames that were left out, and why.

    Raises:
        SequenceError: the folder is in use by something else, nobody said what the assembly is, no
            frame has truth, or none of them can be read.
        RenderError: the truth does not say how much of a part is seen, and nothing can be drawn here.
    """
    source = sequence.source if isinstance(sequence, Prefetcher) else sequence
    if source.assembly is None:
        raise SequenceError(f"{source.name} names no assembly, which gives the classes: name one")
    places = _labelled_places(source, source.assembly, truth, gone, unchecked=unchecked)
    folder = folder.expanduser().resolve()
    check_target(folder, source)
    subject = Subject.of(source.assembly)
    kept: dict[int, FrameTruth] = {}
    left_out: dict[int, str] = {}
    with MissingShares(source.assembly) as missing:
        for frame in readable_frames(source, places, left_out, progress=progress):
            known = missing.filled(truth[frame.index], frame.camera, frame.depth)
            if not kept:
                _write_about(source, source.assembly, folder)
            write_bytes(folder / "images" / f"{frame.index:06d}.png", _image(frame, with_depth))
            text = label_file(frame, known, subject)
            write_text(folder / "labels" / f"{frame.index:06d}.txt", text)
            kept[frame.index] = known
    for room in ("images", "labels"):
        remove_others(folder / room, {str(index) for index in kept})
    write_text(folder / STATES, json.dumps(states(kept, source.assembly), indent=1) + "\n")
    return left_out


def _labelled_places(
    source: Sequence,
    assembly: Assembly,
    truth: Mapping[int, FrameTruth],
    gone: Collection[tuple[int, str]],
    *,
    unchecked: bool,
) -> list[int]:
    frames, parts = source.frame_indices, assembly.parts
    doubtful = [] if unchecked else unchecked_frames(truth, frames, parts, gone)
    places = [
        place
        for place, index in enumerate(frames)
        if index in truth
        and index not in doubtful
        and says_what_is_there(truth[index], parts, gone)
    ]
    if places:
        return places
    why = (
        f": in {counted(len(doubtful), 'frame')} nobody said of all parts whether they are there; place "
        "them, take them away, or export unchecked ones, too"
    )
    raise SequenceError(
        f"no frame of {source.name} has truth to make labels from{why if doubtful else ''}"
    )


def _write_about(source: Sequence, assembly: Assembly, folder: Path) -> None:
    # Named first, so that an export that was cut off can be repeated in its folder.
    write_text(folder / "sequence.json", json.dumps(about_export(source), indent=1) + "\n")
    write_text(folder / "camera.json", json.dumps(camera_content(source.camera, 1.0)) + "\n")
    write_text(folder / "data.yaml", _classes(assembly))


def label_file(frame: Frame, truth: FrameTruth, subject: Subject) -> str:
    """The label file of one frame; what the frame's depth shows in front of a keypoint hides it."""
    objects = tuple(
        SceneObject(name, T_camera_part, truth.visible.get(name))
        for name, T_camera_part in truth.T_camera_part.items()
    )
    state = _state_of(truth, subject.assembly)
    groups = () if state is None else (Group(state.name, None),)
    size = (frame.camera.width, frame.camera.height)
    labeller = Labeller(subject, frame.camera.K, size, frame.depth, SMALLEST_VISIBLE)
    return yolo_rows(labeller.labels(objects, groups), width=size[0], height=size[1])


def _state_of(truth: FrameTruth, assembly: Assembly) -> State | None:
    """The state to label; None where it is not known, or several errors may be meant."""
    if truth.state is None:
        return None
    if not truth.is_error:
        return assembly.steps[truth.state]
    errors = fitting_errors(truth, assembly)
    return errors[0] if len(errors) == 1 else None


def _classes(assembly: Assembly) -> str:
    content = {
        "path": ".",
        "train": "images",
        "val": "images",
        "kpt_shape": [KEYPOINTS, 3],
        "names": dict(enumerate(assembly.detector_classes)),
    }
    return yaml.safe_dump(content, sort_keys=False, allow_unicode=True)


def _image(frame: Frame, with_depth: bool) -> bytes:
    pixels: np.ndarray = cv2.cvtColor(frame.rgb, cv2.COLOR_RGB2BGR)
    if with_depth:
        depth = np.zeros(frame.rgb.shape[:2]) if frame.depth is None else frame.depth
        depth_mm = np.rint(np.clip(depth * 1e3, 0, 65535)).astype(np.uint16)
        pixels = np.dstack([pixels.astype(np.uint16) << 8, depth_mm])
    return encoded(pixels)
