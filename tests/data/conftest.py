"""A tiny assembly and a writer of tiny scene folders: two boxes over a table, depth by formula."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Mesh, Part, State
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from

WIDTH, HEIGHT = 96, 64
CAMERA = {"fx": 90.0, "fy": 91.0, "cx": 47.0, "cy": 31.0, "width": WIDTH, "height": HEIGHT}
FRAMES = (3, 4, 7)


def box(x: float, y: float, z: float) -> Mesh:
    corners = [(i, j, k) for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in sides for face in ((a, c, b), (a, d, c))]
    vertices = (np.array(corners, dtype=np.float64) - 0.5) * [x, y, z]
    return Mesh(vertices, np.array(faces, dtype=np.int32))


def part(name: str, mesh: Mesh, obj_id: int) -> Part:
    return Part(
        name=name,
        mesh=mesh,
        keypoints=np.resize(mesh.vertices, (17, 3)),
        symmetries=Symmetries(),
        diameter=diameter(mesh.vertices),
        color=np.array([10, 120, 200], dtype=np.uint8),
        detector_class=name,
        obj_id=obj_id,
    )


def make_assembly(path: str = "/nowhere/assembly.yaml") -> Assembly:
    parts = {
        "base": part("base", box(0.1, 0.06, 0.02), 1),
        "jaw": part("jaw", box(0.03, 0.03, 0.03), 2),
        "pin": part("pin", box(0.01, 0.01, 0.05), 5),
        "pin-Copy": part("pin-Copy", box(0.01, 0.01, 0.05), 5),
    }
    poses = {"base": np.eye(4)}
    jaw = {**poses, "jaw": transform_from(np.eye(3), np.array([0.0, 0.0, 0.025]))}
    states = (
        State(0, "bare", poses),
        State(1, "jaw on", jaw, detector_class="tiny:jaw on"),
        State(2, "jaw lost", poses, is_error=True, after=1, detector_class="tiny:jaw lost"),
    )
    return Assembly(
        name="tiny",
        title="Tiny",
        base="base",
        parts=parts,
        states=states,
        transitions=frozenset({(0, 1), (1, 2), (2, 1)}),
        detector_classes=("base", "jaw", "pin", "tiny:jaw on", "tiny:jaw lost"),
        path=path,
    )


@pytest.fixture(scope="session")
def tiny() -> Assembly:
    return make_assembly()


@dataclass(frozen=True)
class Scene:
    """A written scene folder and what was put in."""

    folder: Path
    rgb: dict[int, np.ndarray]
    raw_depth: dict[int, np.ndarray]
    poses: dict[int, dict[str, np.ndarray]]

    def write(self, name: str, content: object) -> None:
        (self.folder / name).write_text(json.dumps(content), encoding="utf-8")

    def read(self, name: str) -> Any:
        return json.loads((self.folder / name).read_text(encoding="utf-8"))


def smooth_image(index: int) -> np.ndarray:
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    planes = [(u * 2 + index) % 256, (v * 3) % 256, (u + v) % 256]
    return np.stack(planes, axis=2).astype(np.uint8)


def true_poses(index: int) -> dict[str, np.ndarray]:
    R = rotation_about(np.array([0.3, -0.2, 1.0]), 0.1 * index)
    return {
        "base": transform_from(R, np.array([0.011, -0.023, 0.5 + 0.001 * index])),
        "jaw": transform_from(R @ R, np.array([-0.05, 0.04, 0.4])),
    }


def gt_entry(obj_id: int | str, T: np.ndarray) -> dict[str, object]:
    return {
        "obj_id": obj_id,
        "cam_R_m2c": T[:3, :3].reshape(-1).tolist(),
        "cam_t_m2c": (T[:3, 3] * 1000).tolist(),
    }


def write_images(folder: Path, indices: tuple[int, ...], suffix: str) -> Scene:
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    rgb = {i: smooth_image(i) for i in indices}
    raw = {i: np.full((HEIGHT, WIDTH), 500 + i, dtype=np.uint16) for i in indices}
    for i in indices:
        raw[i][:5] = 0
        cv2.imwrite(str(folder / "rgb" / f"{i:06d}{suffix}"), rgb[i][..., ::-1])
        cv2.imwrite(str(folder / "depth" / f"{i:06d}.png"), raw[i])
    return Scene(folder, rgb, raw, {i: true_poses(i) for i in indices})


@pytest.fixture
def write_scene(tmp_path: Path) -> Callable[..., Scene]:
    """Write a scene of a format; the truth holds both boxes and one stranger."""

    def write(kind: str = "gbot", *, name: str = "scene", suffix: str = ".png") -> Scene:
        scene = write_images(tmp_path / name, FRAMES, suffix)
        if kind == "folder":
            scene.write("camera.json", {**CAMERA, "depth_scale": 1.0})
            return scene
        K = [CAMERA["fx"], 0, CAMERA["cx"], 0, CAMERA["fy"], CAMERA["cy"], 0, 0, 1]
        scene.write("scene_camera.json", {str(i): {"cam_K": K, "depth_scale": 0.5} for i in FRAMES})
        ids: dict[str, int | str]
        ids = {"base": 1, "jaw": 2} if kind == "bop" else {"base": "base", "jaw": "jaw"}
        stranger = 99 if kind == "bop" else "mug"
        truth = {
            str(i): [
                gt_entry(stranger, np.eye(4)),
                *(gt_entry(ids[part], T) for part, T in scene.poses[i].items()),
            ]
            for i in FRAMES
        }
        scene.write("scene_gt.json", truth)
        shares = [{"visib_fract": 1.0}, {"visib_fract": 0.75}, {"visib_fract": 0.0}]
        scene.write("scene_gt_info.json", {str(i): shares for i in FRAMES})
        states = [
            {"frame": 3, "state": 0, "is_error": False, "attached": ["base"], "name": "bare"},
            {"frame": 4, "state": 1, "is_error": False, "attached": ["base", "jaw"]},
            {"frame": 7, "state": 1, "is_error": True, "attached": ["base"], "by": "hand"},
        ]
        scene.write("states.json", states)
        return scene

    return write
