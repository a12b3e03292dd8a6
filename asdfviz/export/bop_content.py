"""What stands in the JSON files of a BOP scene: millimetres, rotations row by row.

obj_id is a part's name, as in GBOT's files, or its number, as in BOP's.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, Camera, FrameTruth, Part, Sequence
from asdfviz.errors import SequenceError
from asdfviz.geometry.transforms import is_rigid

_MM = 1e3

Ids: TypeAlias = Literal["names", "numbers"]
"""What obj_id is: the part's name or its number."""


def camera_content(camera: Camera, depth_scale: float) -> dict[str, float]:
    """camera.json: `depth_scale` is millimetres per unit of the depth images."""
    return {
        "fx": float(camera.K[0, 0]),
        "fy": float(camera.K[1, 1]),
        "cx": float(camera.K[0, 2]),
        "cy": float(camera.K[1, 2]),
        "width": camera.width,
        "height": camera.height,
        "depth_scale": depth_scale,
    }


def scene_camera_entry(camera: Camera, depth_scale: float) -> dict[str, object]:
    """One frame of scene_camera.json."""
    return {"cam_K": camera.K.reshape(-1).tolist(), "depth_scale": depth_scale}


def scene_gt(
    truth: Mapping[int, FrameTruth], sequence: Sequence, ids: Ids = "names"
) -> dict[str, object]:
    """scene_gt.json, with every digit that the numbers have.

    Raises:
        SequenceError: truth of a frame or part that does not exist, a pose that is not rigid, or
            numbers of parts that no assembly tells.
    """
    frames = set(sequence.frame_indices)
    if ids == "numbers" and sequence.assembly is None:
        raise SequenceError(f"{sequence.name} names no assembly that has numbers: give one")
    content: dict[str, object] = {}
    for index, of_frame in sorted(truth.items()):
        if index not in frames:
            raise SequenceError(f"truth of frame {index}, which {sequence.name} does not have")
        content[str(index)] = [
            _object(name, T_camera_part, index, sequence.assembly, ids)
            for name, T_camera_part in of_frame.T_camera_part.items()
        ]
    return content


def _object(
    name: str, T_camera_part: np.ndarray, index: int, assembly: Assembly | None, ids: Ids
) -> dict[str, object]:
    if assembly is not None and name not in assembly.parts:
        raise SequenceError(
            f"truth of frame {index}: '{name}' is no part of {assembly.name}; parts: "
            f"{', '.join(assembly.parts)}"
        )
    if not is_rigid(T_camera_part):
        raise SequenceError(f"truth of frame {index}: the pose of '{name}' is no rigid transform")
    return {
        "obj_id": name if assembly is None else _id(assembly.parts[name], ids),
        "cam_R_m2c": T_camera_part[:3, :3].reshape(-1).tolist(),
        "cam_t_m2c": (T_camera_part[:3, 3] * _MM).tolist(),
    }


def scene_gt_info(truth: Mapping[int, FrameTruth]) -> dict[str, object] | None:
    """scene_gt_info.json in the order of `scene_gt`; None where no visibility is known."""
    if not any(of_frame.visible for of_frame in truth.values()):
        return None
    return {
        str(index): [
            {"visib_fract": float(of_frame.visible[name])} if name in of_frame.visible else {}
            for name in of_frame.T_camera_part
        ]
        for index, of_frame in sorted(truth.items())
    }


def unchecked(truth: Mapping[int, FrameTruth]) -> dict[str, list[str]]:
    """unchecked.json: by frame, names of the parts without a pose that may be there all the same."""
    return {
        str(index): list(of_frame.unchecked)
        for index, of_frame in sorted(truth.items())
        if of_frame.unchecked
    }


def states(truth: Mapping[int, FrameTruth], assembly: Assembly | None) -> list[dict[str, object]]:
    """states.json: an entry for every frame whose state is known, with the name that synth gives it."""
    entries: list[dict[str, object]] = []
    for index, of_frame in sorted(truth.items()):
        if of_frame.state is None:
            continue
        entry: dict[str, object] = {"frame": index, "state": of_frame.state}
        if of_frame.is_error is not None:
            entry["is_error"] = of_frame.is_error
        if of_frame.attached is not None:
            entry["attached"] = list(of_frame.attached)
        name = of_frame.error
        if assembly is not None and not of_frame.is_error:
            name = assembly.steps[of_frame.state].name
        if name is not None:
            entry["name"] = name
        entries.append(entry)
    return entries


def models_info(assembly: Assembly, ids: Ids = "names") -> dict[str, object]:
    """models_info.json by obj_id: size, diameter and symmetries in mm."""
    return {str(_id(part, ids)): _model(part) for part in assembly.parts.values()}


def _id(part: Part, ids: Ids) -> int | str:
    if ids == "names":
        return part.name
    if part.obj_id is None:
        raise SequenceError(f"part '{part.name}' has no obj_id: give it one, or export names")
    return part.obj_id


def _model(part: Part) -> dict[str, object]:
    low = part.mesh.vertices.min(axis=0) * _MM
    size = part.mesh.vertices.max(axis=0) * _MM - low
    model: dict[str, object] = {"diameter": part.diameter * _MM}
    model |= {f"min_{axis}": float(low[i]) for i, axis in enumerate("xyz")}
    model |= {f"size_{axis}": float(size[i]) for i, axis in enumerate("xyz")}
    if part.symmetries.discrete:
        model["symmetries_discrete"] = [_row_mm(S) for S in part.symmetries.discrete]
    if part.symmetries.continuous:
        model["symmetries_continuous"] = [
            {"axis": axis.direction.tolist(), "offset": (axis.offset * _MM).tolist()}
            for axis in part.symmetries.continuous
        ]
    return model


def _row_mm(T: np.ndarray) -> list[float]:
    row = T.copy()
    row[:3, 3] *= _MM
    return row.reshape(-1).tolist()
