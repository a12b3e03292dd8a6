"""A tracker is started from an annotated frame in a headless browser: progress, poses, undo, cancel."""

from __future__ import annotations

import json
import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser_steps import opened, until, view
from playwright.sync_api import Browser, Page, expect

from asdfviz.app import carrying
from asdfviz.app.main import App, ViewConfig, open_app
from asdfviz.data.run_files import save_run
from asdfviz.datatypes import Assembly, Frame, FramePrediction, Run
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.track import raster

pytestmark = [
    pytest.mark.browser,
    pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection"),
]
K = np.array([[420.0, 0.0, 159.5], [0.0, 420.0, 119.5], [0.0, 0.0, 1.0]])
SIZE = (320, 240)
COUNT = 10
START = 2
"""The frame that is annotated."""


def pose_of(clamp: Assembly, place: int) -> np.ndarray:
    """The jaw turns and goes right."""
    R = rotation_about(np.array([0.2, 1.0, 0.3]), 0.8 + 0.03 * place)
    vertices = clamp.parts["jaw"].mesh.vertices
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return transform_from(R, np.array([-0.02 + 0.004 * place, 0.0, 0.4]) - R @ middle)


@pytest.fixture(scope="module")
def moving_folder(tmp_path_factory: pytest.TempPathFactory, clamp: Assembly) -> Path:
    """A jaw before a wall, seen in colour and depth, without truth; a run that found nothing."""
    folder = tmp_path_factory.mktemp("scene") / "moving"
    for room in ("rgb", "depth"):
        (folder / room).mkdir(parents=True)
    camera = {"cam_K": K.ravel().tolist(), "depth_scale": 1.0}
    files = {
        "scene_camera": {str(i): camera for i in range(COUNT)},
        "sequence": {"assembly": "corner_clamp", "fps": 10},
    }
    for name, content in files.items():
        (folder / f"{name}.json").write_text(json.dumps(content))
    for i in range(COUNT):
        rng = np.random.default_rng(i)
        inverse_depth, ids = raster.new_buffers(*SIZE)
        mesh = clamp.parts["jaw"].mesh
        raster.draw(mesh, pose_of(clamp, i), K=K, inverse_depth=inverse_depth, ids=ids, number=0)
        bgr = rng.integers(90, 170, (SIZE[1], SIZE[0], 3)).astype(np.uint8)
        bgr[ids == 0] = (30, 60, 210)
        metres = np.where(inverse_depth > 0, 1 / np.maximum(inverse_depth, 1e-6), 0.7)
        cv2.imwrite(str(folder / "rgb" / f"{i:06d}.png"), bgr)
        cv2.imwrite(
            str(folder / "depth" / f"{i:06d}.png"), np.round(1000 * metres).astype(np.uint16)
        )
    nothing = tuple(FramePrediction(i, {}, None) for i in range(COUNT))
    save_run(Run("asdf", {}, str(folder), clamp.path, "0", nothing), folder / "runs" / "asdf")
    return folder


@pytest.fixture(scope="module")
def app(moving_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    annotations = tmp_path_factory.mktemp("annotations")
    running = open_app(
        ViewConfig(sequence=str(moving_folder), annotations=annotations, author="ann", port=0)
    )
    yield running
    running.close()


@pytest.fixture(scope="module")
def page(chromium: Browser, app: App, clamp: Assembly) -> Iterator[Page]:
    with opened(chromium, app) as made:
        app.workspace.store.set_pose(START, "jaw", pose_of(clamp, START), provenance="keys")
        app.workspace.changed()
        made.get_by_test_id("tab-annotate").click()
        made.get_by_test_id("part-jaw").click()
        for _ in range(START):
            made.keyboard.press("ArrowRight")
        expect(made.get_by_test_id("frame")).to_have_attribute("data-place", str(START))
        yield made


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """The tracker waits for it before the sixth frame."""
    is_open = threading.Event()
    real = carrying.carry_parts

    def waiting(frame_at: Callable[[int], Frame], *args: Any, **options: Any) -> Any:
        def late(place: int) -> Frame:
            if place == 5:
                assert is_open.wait(120)
            return frame_at(place)

        return real(late, *args, **options)

    monkeypatch.setattr(carrying, "carry_parts", waiting)
    yield is_open
    is_open.set()


def annotated(app: App) -> list[int]:
    return sorted(frame for frame, _ in app.workspace.store.poses())


def test_tracking_shows_its_progress_and_cancelling_changes_nothing(
    page: Page, app: App, gate: threading.Event
) -> None:
    page.get_by_test_id("track-forward").click()
    expect(page.get_by_test_id("tracking")).to_contain_text(re.compile(r"Tracking jaw: [1-3]/\d+"))
    page.get_by_test_id("cancel-tracking").click()
    expect(page.get_by_test_id("tracking")).to_contain_text("Cancelling")
    gate.set()
    expect(page.get_by_test_id("tracking-end")).to_contain_text("nothing was changed")
    assert annotated(app) == [START]


def test_its_poses_arrive_and_go_with_one_undo(
    page: Page, app: App, gate: threading.Event, clamp: Assembly
) -> None:
    page.get_by_test_id("track-both").click()
    expect(page.get_by_test_id("tracking")).to_contain_text(re.compile(r"Tracking jaw: \d+/\d+"))
    gate.set()
    expect(page.get_by_test_id("tracking-end")).to_contain_text(
        f"jaw tracked to {COUNT - 1} frames"
    )
    assert annotated(app) == list(range(COUNT))
    vertices = clamp.parts["jaw"].mesh.vertices
    for place in range(COUNT):
        gap = app.workspace.poses(place, view(app).base)["jaw"].T_camera_part
        gap = gap - pose_of(clamp, place)
        assert np.linalg.norm(vertices @ gap[:3, :3].T + gap[:3, 3], axis=1).mean() < 0.003
    # They are seen: the part has a pose in a frame that nobody annotated.
    page.keyboard.press("End")
    expect(page.get_by_test_id("part-jaw")).to_contain_text("tracked")
    expect(page.get_by_test_id("pose")).to_contain_text("mm")
    page.keyboard.press("Control+z")
    until(lambda: annotated(app) == [START], "one undo takes all of them back")
    expect(page.get_by_test_id("part-jaw")).to_contain_text("no pose")


def test_a_nudged_part_is_fitted_with_a_key(page: Page, app: App, clamp: Assembly) -> None:
    page.keyboard.press("Home")
    for _ in range(START):
        page.keyboard.press("ArrowRight")
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", str(START))
    for _ in range(4):
        page.keyboard.press("l")
    right = pose_of(clamp, START)[:3, 3]

    def off() -> float:
        found = app.workspace.poses(START, view(app).base)["jaw"].T_camera_part
        return float(np.linalg.norm(found[:3, 3] - right))

    until(lambda: off() > 0.0035, "the part was moved")
    page.keyboard.press("f")
    expect(page.get_by_test_id("tracking-end")).to_contain_text("jaw fitted to the picture")
    assert off() < 0.0025
