"""A toy assembly of coloured blocks, and scene folders drawn of it with known poses."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from asdfviz.datatypes import Assembly, Mesh, Part, State
from asdfviz.geometry.sampling import diameter, farthest_points, surface_points
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import apply, rotation_about, transform_from
from asdfviz.train.config import TrainConfig

K = np.array([[230.0, 0, 160], [0, 230, 90], [0, 0, 1]])
WIDTH, HEIGHT = 320, 180
FACE_COLORS = np.array(
    [[220, 40, 40], [40, 200, 60], [50, 80, 230], [230, 210, 40], [200, 60, 210], [60, 210, 220]]
)


@pytest.fixture(scope="session", autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def block(name: str, size: tuple[float, float, float], symmetries: Symmetries) -> Part:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0
    vertices = corners * size
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = np.array([[q[0], *pair] for q in quads for pair in (q[1:3], q[2:4])], np.int32)
    keypoints = farthest_points(surface_points(vertices, faces, 400), 17)
    return Part(
        name=name,
        mesh=Mesh(vertices=vertices, faces=faces),
        keypoints=keypoints,
        symmetries=symmetries,
        diameter=diameter(vertices),
        color=np.array([200, 100, 50], np.uint8),
        detector_class=name,
    )


@pytest.fixture(scope="session")
def assembly() -> Assembly:
    half_turn = transform_from(rotation_about(np.array([0.0, 0.0, 1.0]), np.pi), np.zeros(3))
    parts = {
        "body": block("body", (0.09, 0.06, 0.03), Symmetries()),
        "bar": block("bar", (0.03, 0.03, 0.08), Symmetries(discrete=(half_turn,))),
    }
    T_body_bar = transform_from(np.eye(3), np.array([0.0, 0.0, 0.055]))
    states = (
        State(index=0, name="start", T_base_part={"body": np.eye(4)}),
        State(
            index=1,
            name="joined",
            T_base_part={"body": np.eye(4), "bar": T_body_bar},
            detector_class="toy:joined",
        ),
    )
    return Assembly(
        name="toy",
        title="Toy",
        base="body",
        parts=parts,
        states=states,
        transitions=frozenset({(0, 1)}),
        detector_classes=("body", "bar", "toy:joined"),
        path="toy/assembly.yaml",
    )


def draw(parts: list[tuple[Part, np.ndarray]], shade: int) -> tuple[np.ndarray, np.ndarray]:
    """Painter's algorithm, convex blocks of flat colours; returns RGB and depth in mm."""
    rgb = np.full((HEIGHT, WIDTH, 3), shade, np.uint8)
    depth = np.full((HEIGHT, WIDTH), 1200, np.uint16)
    for part, T_camera_part in sorted(parts, key=lambda pair: -pair[1][2, 3]):
        points = apply(T_camera_part, part.mesh.vertices)
        pixels = points @ K.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        for place, face in enumerate(part.mesh.faces):
            a, b, c = points[face]
            if np.dot(np.cross(b - a, c - a), a) < 0:
                corners = np.round(pixels[face] * 16).astype(np.int32)
                color = FACE_COLORS[place // 2].tolist()
                cv2.fillConvexPoly(rgb, corners, color, cv2.LINE_8, 4)
                nearest = int(points[face][:, 2].mean() * 1000)
                cv2.fillConvexPoly(depth, corners, nearest, cv2.LINE_8, 4)
    return rgb, depth


def write_scene(folder: Path, assembly: Assembly, *, count: int, seed: int) -> Path:
    """Write a BOP scene; every other frame shows the joined state, and a loose second bar."""
    rng = np.random.default_rng(seed)
    (folder / "rgb").mkdir(parents=True)
    (folder / "depth").mkdir()
    body, bar = assembly.parts["body"], assembly.parts["bar"]
    truth: dict[str, object] = {}
    info: dict[str, object] = {}
    states: list[dict[str, object]] = []
    for i in range(count):
        R = rotation_about(rng.normal(size=3), rng.uniform(0, 1.0))
        t = np.array([rng.uniform(-0.06, 0.0), rng.uniform(-0.04, 0.04), rng.uniform(0.4, 0.5)])
        T_camera_body = transform_from(R, t)
        loose = transform_from(
            rotation_about(rng.normal(size=3), rng.uniform(0, 3)), np.array([0.13, 0.0, 0.5])
        )
        placed = [(bar, loose), (body, T_camera_body)]
        joined = i % 2 == 1
        if joined:
            placed.append((bar, T_camera_body @ assembly.states[1].T_base_part["bar"]))
        rgb, depth = draw(placed, int(rng.integers(60, 180)))
        cv2.imwrite(str(folder / f"rgb/{i:06d}.png"), rgb[:, :, ::-1])
        cv2.imwrite(str(folder / f"depth/{i:06d}.png"), depth)
        truth[str(i)] = [
            {
                "obj_id": part.name,
                "cam_R_m2c": T[:3, :3].ravel().tolist(),
                "cam_t_m2c": (T[:3, 3] * 1e3).tolist(),
            }
            for part, T in placed
        ]
        info[str(i)] = [{"visib_fract": 1.0} for _ in placed]
        groups = [{"state": int(joined), "is_error": False, "gt": [1, 2] if joined else [1]}]
        groups[0]["name"] = "joined" if joined else "start"
        states.append({"frame": i, "state": int(joined), "groups": groups})
    camera = {str(i): {"cam_K": K.ravel().tolist(), "depth_scale": 1.0} for i in range(count)}
    files = {"scene_gt": truth, "scene_gt_info": info, "scene_camera": camera, "states": states}
    for name, content in files.items():
        (folder / f"{name}.json").write_text(json.dumps(content))
    return folder


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory, assembly: Assembly) -> Path:
    return write_scene(tmp_path_factory.mktemp("toy") / "scene", assembly, count=8, seed=0)


@pytest.fixture
def new_scene(tmp_path: Path, assembly: Assembly) -> Callable[[int], Path]:
    return lambda count: write_scene(tmp_path / "new_scene", assembly, count=count, seed=1)


@pytest.fixture
def new_config(scene: Path, tmp_path: Path) -> Callable[..., TrainConfig]:
    """Of a small run on the scene, with what else is given."""

    def config(**given: Any) -> TrainConfig:
        folder = tmp_path / "run"
        return TrainConfig(("toy",), (scene,), folder, keypoint_width=64, **given)

    return config
