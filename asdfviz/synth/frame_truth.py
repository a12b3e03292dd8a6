"""What BOP's truth files say of one synthetic frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from asdfviz.geometry.shapes import Transform
from asdfviz.synth.render import Picture
from asdfviz.synth.scene import Group, TrueScene


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
