"""Writes BOP scene folders frame by frame, so that a stopped job goes on where it was.

Each frame leaves one small record under `records/`; `merge` gathers them into scene_gt.json,
scene_gt_info.json, scene_camera.json, states.json, sequence.json and camera.json.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np

from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.datatypes import Camera
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Depth, Rgb, Transform
from asdfviz.synth.render import Picture
from asdfviz.synth.scene import Group, TrueScene

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
    """A BOP scene folder that is being written."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in ("rgb", "records"):
            (folder / name).mkdir(parents=True, exist_ok=True)

    def require_same(self, *, sequence: Mapping[str, object], camera: Camera) -> None:
        """Refuse to go on in a folder that was begun with another assembly, seed or size.

        Raises:
            InputError: naming the file and both values.
        """
        wanted = {"sequence.json": dict(sequence), "camera.json": camera_fields(camera)}
        for name, content in wanted.items():
            file = self.folder / name
            if not file.is_file():
                continue
            begun = json.loads(file.read_text(encoding="utf-8"))
            for key, value in content.items():
                if begun.get(key) != value:
                    raise InputError(
                        f"{file} was begun with {key} {begun.get(key)}, not {value}: take another folder"
                    )

    def has(self, frame: int) -> bool:
        """Whether a frame is already complete."""
        return self._record(frame).is_file()

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
        """Write one frame's images, then its record, each atomically."""
        bgr = cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR)
        quality = [cv2.IMWRITE_JPEG_QUALITY, jpeg_quality]
        _write_image(self.folder / "rgb" / f"{frame:06d}.jpg", bgr, quality)
        if depth is not None:
            (self.folder / "depth").mkdir(exist_ok=True)
            depth_mm = np.round(np.clip(depth, 0, 65.0) * 1000).astype(np.uint16)
            _write_image(self.folder / "depth" / f"{frame:06d}.png", depth_mm, [])
        write_text(self._record(frame), json.dumps(frame_record(frame, true_scene, picture)))

    def merge(self, *, sequence: Mapping[str, object], camera: Camera) -> int:
        """Gather all records into the BOP files; returns how many frames there are."""
        records = [
            json.loads(p.read_text()) for p in sorted((self.folder / "records").glob("*.json"))
        ]
        files: dict[str, object] = {
            "scene_gt.json": {str(r["frame"]): r["gt"] for r in records},
            "scene_gt_info.json": {str(r["frame"]): r["info"] for r in records},
            "scene_camera.json": {str(r["frame"]): r["camera"] for r in records},
            "states.json": [r["state"] for r in records],
            "sequence.json": dict(sequence),
            "camera.json": camera_fields(camera),
        }
        for name, content in files.items():
            write_text(self.folder / name, _dump(content))
        return len(records)

    def finish(self) -> None:
        """Remove the records of a complete folder."""
        for path in (self.folder / "records").glob("*.json"):
            path.unlink()
        (self.folder / "records").rmdir()

    def _record(self, frame: int) -> Path:
        return self.folder / "records" / f"{frame:06d}.json"


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


def frame_record(frame: int, true_scene: TrueScene, picture: Picture) -> dict[str, Any]:
    """Everything the truth files say of one frame."""
    scene = true_scene.scene
    order = truth_order(true_scene)
    place = {index: k for k, index in enumerate(order)}
    groups = [_group(g, place) for g in true_scene.groups]
    main = None if true_scene.main is None else true_scene.groups[true_scene.main]
    state: dict[str, Any] = {"frame": frame, "state": None, "is_error": False, "attached": []}
    if main is not None:
        state |= {
            "state": main.state.completed,
            "is_error": main.state.is_error,
            "attached": list(main.state.attached),
            "name": main.state.name,
        }
    return {
        "frame": frame,
        "gt": [
            _pose(scene.placed[i].name, scene.T_camera_world @ scene.placed[i].T_world_mesh)
            for i in order
        ],
        "info": [_info(i, picture) for i in order],
        "camera": {"cam_K": [float(x) for x in scene.camera.K.reshape(-1)], "depth_scale": 1.0},
        "state": {**state, "groups": groups},
    }


def truth_order(true_scene: TrueScene) -> list[int]:
    """Places of the truth's objects: second copies first, so that readers that keep one keep the real one."""
    seen: set[str] = set()
    real: list[int] = []
    copies: list[int] = []
    for i, thing in enumerate(true_scene.scene.placed):
        if thing.truth:
            (copies if thing.name in seen else real).append(i)
            seen.add(thing.name)
    return copies + real


def _group(group: Group, place: Mapping[int, int]) -> dict[str, Any]:
    return {
        "state": group.state.completed,
        "is_error": group.state.is_error,
        "name": group.state.name,
        "gt": [place[i] for i in group.members],
    }


def _pose(name: str, T_camera_part: Transform) -> dict[str, Any]:
    return {
        "obj_id": name,
        "cam_R_m2c": [round(float(x), 9) for x in T_camera_part[:3, :3].reshape(-1)],
        "cam_t_m2c": [round(float(x) * 1000, 6) for x in T_camera_part[:3, 3]],
    }


def _info(index: int, picture: Picture) -> dict[str, Any]:
    mask = picture.ids == index
    seen = int(mask.sum())
    everything = max(int(picture.silhouette_px[index]), seen)
    box = [-1, -1, -1, -1]
    if seen:
        v, u = np.nonzero(mask)
        box = [int(u.min()), int(v.min()), int(np.ptp(u)) + 1, int(np.ptp(v)) + 1]
    return {
        "bbox_obj": [int(x) for x in picture.silhouette_box[index]],
        "bbox_visib": box,
        "px_count_all": everything,
        "px_count_visib": seen,
        "visib_fract": round(seen / everything, 5) if everything else 0.0,
    }


def _dump(content: object) -> str:
    """JSON with one line an entry, for files that people read and compare."""
    if isinstance(content, dict):
        named = cast(dict[str, object], content)
        rows = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in named.items()]
        return "{\n" + ",\n".join(rows) + "\n}\n"
    rows = [f"  {json.dumps(entry)}" for entry in cast(list[object], content)]
    return "[\n" + ",\n".join(rows) + "\n]\n"


def _write_image(path: Path, image: np.ndarray, options: Sequence[int]) -> None:
    done, data = cv2.imencode(path.suffix, image, list(options))
    if not done:
        raise OSError(f"{path} could not be encoded")
    write_bytes(path, data.tobytes())
