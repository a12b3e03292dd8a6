"""Writes BOP scene folders frame by frame, so that a stopped or killed job goes on where it was.

    rgb/NNNNNN.jpg  depth/NNNNNN.png  labels/NNNNNN.txt (YOLO-pose)
    mask/NNNNNN_KKKKKK.png  mask_visib/NNNNNN_KKKKKK.png on request (K: place in scene_gt.json)

The last thing that a frame leaves is one small record under `records/`; `merge` gathers them into
scene_gt.json, scene_gt_info.json, scene_camera.json and states.json. sequence.json and camera.json
are there from the beginning and say what the folder was begun with.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.data.encoding import encoded
from asdfviz.data.json_files import read_json
from asdfviz.data.resources import way_to_assembly
from asdfviz.data.scene_objects import SCENE_GT, SCENE_GT_INFO
from asdfviz.data.truth import STATES
from asdfviz.datatypes import Assembly, Camera
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Depth, Rgb
from asdfviz.pose.labels import Subject
from asdfviz.synth.assets import Assets
from asdfviz.synth.description import Scene
from asdfviz.synth.frame_labels import label_text, silhouette_masks
from asdfviz.synth.frame_truth import frame_record, truth_order
from asdfviz.synth.mesh_bank import MeshBank
from asdfviz.synth.render import Picture
from asdfviz.synth.scene import TrueScene

SMALLEST, LARGEST = 64, 4096
"""Sides of an image that the generator takes, pixels."""


def require_size(width: int, height: int) -> None:
    """Refuse image sizes that cannot be rendered.

    Raises:
        InputError: with the size and what would be right.
    """
    if not (SMALLEST <= width <= LARGEST and SMALLEST <= height <= LARGEST):
        raise InputError(
            f"image size {width}x{height}: sides must be {SMALLEST} to {LARGEST} pixels"
        )


class SceneFolder:
    """A BOP scene folder that is being written.

    Args:
        folder: where it is or will be.
        assets: of the assembly; with them, frames get labels.
        masks: whether frames get masks too; needs the assets.
    """

    def __init__(self, folder: Path, *, assets: Assets | None = None, masks: bool = False) -> None:
        self.folder = folder
        self._assets = assets
        self._masks = masks
        self._subject = None if assets is None else Subject.of(assets.assembly)
        self._finished: frozenset[int] = frozenset()
        if (folder / STATES).is_file() and not self._records.is_dir():
            entries = read_json(folder / STATES, error=InputError).entries()
            self._finished = frozenset(entry.get("frame").integer() for entry in entries)

    def begin(self, assembly: Assembly, *, sequence: Mapping[str, object], camera: Camera) -> None:
        """Note what the folder is for, or see that it was begun for the same.

        Args:
            assembly: whose name, and where it lies, sequence.json begins with; it may lie elsewhere
                when the job goes on.
            sequence: the rest of sequence.json: the seed and whatever else the images depend on.
            camera: content of camera.json.

        Raises:
            InputError: the folder holds something else, or was begun with another seed, size ...
        """
        wanted = {
            "sequence.json": {"assembly": assembly.name, **sequence},
            "camera.json": camera_fields(camera),
        }
        if not (self.folder / "sequence.json").is_file() and self._strangers():
            raise InputError(
                f"{self.folder} holds something else ({', '.join(self._strangers()[:4])}): take "
                "another folder"
            )
        for name, content in wanted.items():
            file = self.folder / name
            if file.is_file():
                require_equal(file, json.loads(json.dumps(content)))
            elif name == "sequence.json":
                write_text(file, _dump({**content, **way_to_assembly(assembly, self.folder)}))
            else:
                write_text(file, _dump(content))
        if not self._finished:
            self._records.mkdir(exist_ok=True)

    def has(self, frame: int) -> bool:
        """Whether a frame is already complete."""
        return frame in self._finished or self._record(frame).is_file()

    def write_frame(
        self,
        frame: int,
        true_scene: TrueScene,
        picture: Picture,
        *,
        rgb: Rgb,
        depth: Depth | None,
        jpeg_quality: int = 92,
    ) -> None:
        """Write one frame's images, labels and masks, then its record, each atomically.

        Raises:
            InputError: the folder holds a finished recording, which has no such frame.
        """
        if self._finished:
            raise InputError(
                f"{self.folder} holds a finished recording of {len(self._finished)} frames: take "
                "another folder"
            )
        bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
        quality = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
        write_image(self.folder / "rgb" / f"{frame:06d}.jpg", bgr, quality)
        if depth is not None:
            depth_mm = np.round(np.clip(depth, 0, 65.0) * 1000).astype(np.uint16)
            write_image(self.folder / "depth" / f"{frame:06d}.png", depth_mm)
        order = truth_order(true_scene)
        if self._subject is not None:
            text = label_text(true_scene, picture, order, self._subject)
            write_text(self.folder / "labels" / f"{frame:06d}.txt", text)
        if self._masks and self._assets is not None:
            self._write_masks(frame, true_scene.scene, picture, order, self._assets.bank)
        write_text(self._record(frame), json.dumps(frame_record(frame, true_scene, picture)))

    def _write_masks(
        self, frame: int, scene: Scene, picture: Picture, order: Sequence[int], bank: MeshBank
    ) -> None:
        whole = silhouette_masks(scene, bank, order)
        for k, (index, mask) in enumerate(zip(order, whole, strict=True)):
            name = f"{frame:06d}_{k:06d}.png"
            for room, pixels in (("mask", mask), ("mask_visib", picture.ids == index)):
                write_image(self.folder / room / name, pixels.astype(np.uint8) * 255)

    def merge(self) -> int:
        """Gather all records into the BOP files; returns how many frames there are."""
        if self._finished:
            return len(self._finished)
        records = [json.loads(p.read_text()) for p in sorted(self._records.glob("*.json"))]
        files: dict[str, object] = {
            SCENE_GT: {str(r["frame"]): r["gt"] for r in records},
            SCENE_GT_INFO: {str(r["frame"]): r["info"] for r in records},
            "scene_camera.json": {str(r["frame"]): r["camera"] for r in records},
            STATES: [r["state"] for r in records],
        }
        for name, content in files.items():
            write_text(self.folder / name, _dump(content))
        return len(records)

    def finish(self) -> None:
        """Remove the records of a complete folder: it then counts as finished."""
        if self._records.is_dir():
            shutil.rmtree(self._records)

    @property
    def is_finished(self) -> bool:
        """Whether the folder held a finished recording when it was opened."""
        return bool(self._finished)

    @property
    def frames_done(self) -> int:
        """How many frames are complete by now."""
        return len(self._finished) or sum(1 for _ in self._records.glob("*.json"))

    @property
    def _records(self) -> Path:
        return self.folder / "records"

    def _record(self, frame: int) -> Path:
        return self._records / f"{frame:06d}.json"

    def _strangers(self) -> list[str]:
        """What lies in the folder; hidden files do not count."""
        if not self.folder.is_dir():
            return []
        return sorted(p.name for p in self.folder.iterdir() if not p.name.startswith("."))


def require_equal(file: Path, wanted: Mapping[str, object]) -> None:
    """See that a folder was begun with these values.

    Raises:
        InputError: with the first one that differs.
    """
    begun = read_json(file, error=InputError).items()
    for key, value in wanted.items():
        there = begun[key].value if key in begun else None
        if there != value:
            raise InputError(
                f"{file} was begun with {key} {there}, not {value}: take another folder"
            )


def camera_fields(camera: Camera) -> dict[str, float]:
    """The content of camera.json."""
    K = camera.K
    return {
        "fx": K[0, 0],
        "fy": K[1, 1],
        "cx": K[0, 2],
        "cy": K[1, 2],
        "width": camera.width,
        "height": camera.height,
        "depth_scale": 1.0,
    }


def _dump(content: object) -> str:
    """JSON with one line an entry, for files that people read and compare."""
    if isinstance(content, dict):
        named = cast(dict[str, object], content)
        rows = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in named.items()]
        return "{\n" + ",\n".join(rows) + "\n}\n"
    rows = [f"  {json.dumps(entry)}" for entry in cast(list[object], content)]
    return "[\n" + ",\n".join(rows) + "\n]\n"


def write_image(path: Path, image: np.ndarray, options: Sequence[int] = ()) -> None:
    """Encode an image by the suffix of its name and write it atomically."""
    write_bytes(path, encoded(image, suffix=path.suffix, options=options))
