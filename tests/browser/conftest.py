"""A headless Chromium, and a small scene folder with truth and one run for it to show.

Without Chromium the tests skip with a reason, but fail where CI=true promises one.
"""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser, sync_playwright

from asdfviz.data.assembly import load_assembly
from asdfviz.data.run_files import save_run
from asdfviz.datatypes import Assembly, FramePrediction, PoseEstimate, Run, StateEstimate
from asdfviz.geometry.transforms import transform_from

FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
K = np.array([[420.0, 0.0, 331.0], [0.0, 420.0, 232.0], [0.0, 0.0, 1.0]])
SIZE = (640, 480)
COUNT = 12
MARKS = np.array([[-0.2, -0.12, 0.5], [0.2, -0.1, 0.6], [0.17, 0.14, 0.55], [-0.25, 0.15, 0.7]])
"""Points (metres, camera frame) that are painted into every picture as green discs."""
CENTRES = {"base": (-0.06, 0.0, 0.5), "jaw": (0.05, -0.02, 0.5), "bolt": (0.08, 0.06, 0.5)}


@pytest.fixture(scope="session")
def chromium() -> Iterator[Browser]:
    path = os.environ.get("CHROMIUM") or shutil.which("chromium") or "/usr/bin/chromium"
    if not Path(path).is_file():
        message = f"no Chromium at {path} (apt-get install chromium, or CHROMIUM=path)"
        if os.environ.get("CI") == "true":
            pytest.fail(message)
        pytest.skip(message)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS, headless=True)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def clamp() -> Assembly:
    return load_assembly("corner_clamp")


@pytest.fixture(scope="session")
def scene_folder(tmp_path_factory: pytest.TempPathFactory, clamp: Assembly) -> Path:
    folder = tmp_path_factory.mktemp("scene") / "desk"
    write_scene(folder, clamp)
    save_run(make_run(folder, clamp), folder / "runs" / "asdf")
    return folder


@pytest.fixture(scope="session")
def marks() -> np.ndarray:
    return MARKS


def T_camera_part_of(clamp: Assembly, part: str) -> np.ndarray:
    """The part upright before the camera, its middle at its centre of `CENTRES`."""
    R = np.diag([1.0, -1.0, -1.0])
    vertices = clamp.parts[part].mesh.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return transform_from(R, np.array(CENTRES[part]) - R @ middle)


def write_scene(folder: Path, clamp: Assembly) -> None:
    for room in ("rgb", "depth"):
        (folder / room).mkdir(parents=True)
    truth = {
        str(i): [
            {
                "obj_id": part,
                "cam_R_m2c": T_camera_part_of(clamp, part)[:3, :3].ravel().tolist(),
                "cam_t_m2c": (1000 * T_camera_part_of(clamp, part)[:3, 3]).tolist(),
            }
            for part in clamp.parts
        ]
        for i in range(COUNT)
    }
    camera = {"cam_K": K.ravel().tolist(), "depth_scale": 1.0}
    states = [
        {
            "frame": i,
            "state": i // 4,
            "is_error": False,
            "attached": list(clamp.states[i // 4].attached),
        }
        for i in range(COUNT)
    ]
    files = {
        "scene_gt": truth,
        "scene_camera": dict.fromkeys(truth, camera),
        "states": states,
        "sequence": {"assembly": "corner_clamp", "fps": 10},
    }
    for name, content in files.items():
        (folder / f"{name}.json").write_text(json.dumps(content))
    for i in range(COUNT):
        cv2.imwrite(str(folder / "rgb" / f"{i:06d}.png"), paint(i)[:, :, ::-1])
        depth = np.full((SIZE[1], SIZE[0]), 500, np.uint16)
        cv2.imwrite(str(folder / "depth" / f"{i:06d}.png"), depth)


def paint(number: int) -> np.ndarray:
    """A grey picture, lighter from frame to frame, with a green disc on every mark."""
    rgb = np.full((SIZE[1], SIZE[0], 3), 40 + 8 * number, np.uint8)
    pixels = cv2.projectPoints(MARKS, np.zeros(3), np.zeros(3), K, None)[0][:, 0]
    for u, v in pixels * 16:  # 4 fractional bits
        cv2.circle(rgb, (round(u), round(v)), 9 * 16, (0, 190, 0), -1, cv2.LINE_AA, 4)
    return rgb


def make_run(folder: Path, clamp: Assembly) -> Run:
    """The truth, 4 mm too far to the right."""
    predictions: list[FramePrediction] = []
    for i in range(COUNT):
        poses = {
            part: PoseEstimate(
                part,
                transform_from(np.eye(3), np.array([0.004, 0, 0])) @ T_camera_part_of(clamp, part),
                0.9,
                "refined",
            )
            for part in clamp.parts
        }
        probabilities = np.full(len(clamp.states), 0.05)
        probabilities[i // 4] = 1.0
        state = StateEstimate(probabilities / probabilities.sum())
        predictions.append(FramePrediction(i, poses, state, runtime={"total": 0.03}))
    return Run("asdf", {}, str(folder), clamp.path, "0", tuple(predictions))
