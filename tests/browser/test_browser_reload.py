"""Corrections survive: a part is dragged by its gizmo, saved, there again after a restart, and exported."""

from __future__ import annotations

import contextlib
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from browser_steps import canvas_box, client, on_screen, opened, until
from playwright.sync_api import Browser, Page, expect

from asdfviz.annotate.paths import annotation_file
from asdfviz.annotate.records import PoseAnnotation
from asdfviz.annotate.store import AnnotationStore
from asdfviz.app.main import App, ViewConfig, open_app
from asdfviz.data.gbot_import import import_gbot
from asdfviz.data.sequences import open_sequence
from asdfviz.data.truth import read_truth
from asdfviz.datatypes import Assembly

pytestmark = [
    pytest.mark.browser,
    pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection"),
]

SIZE = (1000, 640)
"""Of the window: every step of a drag is drawn in software."""


@pytest.fixture(scope="module")
def workpiece(
    request: pytest.FixtureRequest, scene_folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path, str]:
    """Sequence, assembly and part to correct: the real frames where they are, else the painted ones."""
    clamp: Assembly = request.getfixturevalue("clamp")
    try:
        shared: Path = request.getfixturevalue("shared")
    except pytest.skip.Exception:
        return scene_folder, Path(clamp.path), "jaw"
    models = tmp_path_factory.mktemp("models")
    import_gbot(shared / "data" / "gbot", models)
    # An annotator's blank start: without weights no run lays its own meshes over the gizmo.
    # A copy: what is shared stays as it is.
    frames = tmp_path_factory.mktemp("frames") / "real"
    shutil.copytree(shared / "data" / "real", frames, copy_function=shutil.copyfile)
    return frames, models / "gbot_nanovise", "NanoViseV2_VISE_BASE"


def test_a_part_is_dragged_saved_reloaded_and_exported(
    chromium: Browser, workpiece: tuple[Path, Path, str], tmp_path: Path
) -> None:
    sequence, assembly, part = workpiece
    config = ViewConfig(
        sequence=str(sequence), assembly=str(assembly), annotations=tmp_path, port=0
    )
    with contextlib.closing(open_app(config)) as app, opened(chromium, app, size=SIZE) as page:
        T_dragged = _drag(page, app, part)
        name = app.workspace.assembly.name
    # What is on disk is what was seen, to the last bit.
    file = annotation_file(sequence.name, folder=tmp_path)
    with AnnotationStore(file, sequence_name=sequence.name, assembly_name=name) as store:
        kept = store.pose(app.workspace.indices[0], part)
        assert kept is not None
        assert kept.provenance == "gizmo"
        assert kept.T_camera_part is not None
        assert np.array_equal(kept.T_camera_part, T_dragged)
    with contextlib.closing(open_app(config)) as app, opened(chromium, app, size=SIZE) as page:
        page.get_by_test_id("tab-annotate").click()
        expect(page.get_by_test_id(f"part-{part}")).to_contain_text(
            "corrected" if app.workspace.runs else "placed by hand"
        )
        assert np.array_equal(app.workspace.poses(0, None)[part].T_camera_part, T_dragged)
        page.get_by_test_id("tab-results").click()
        page.get_by_test_id("export").click()
        until(lambda: app.workspace.messages, "the export ends")
        assert not app.workspace.messages[-1].is_problem, app.workspace.messages[-1]
        folder = app.workspace.export_folder
        index, read = app.workspace.indices[0], app.workspace.assembly
    assert read_truth(folder, read)[index].T_camera_part[part] == pytest.approx(T_dragged, abs=1e-6)
    assert len(open_sequence(folder, assembly=read)) == len(app.workspace.indices)


def _drag(page: Page, app: App, part: str) -> np.ndarray:
    """Put the part into the middle and pull one of the gizmo's arrows 60 pixels outwards."""
    until(lambda: not (app.workspace.job and app.workspace.job.is_active), "the first run ends")
    page.get_by_test_id("tab-annotate").click()
    page.get_by_test_id(f"part-{part}").click()
    index = app.workspace.indices[0]
    page.keyboard.press("Delete")  # what a run says of it: a part that has a pose keeps it
    page.keyboard.press("Shift+Enter")
    T = until(lambda: _placed(app, index, part), "the part is placed").T_camera_part
    vertices = app.workspace.assembly.parts[part].mesh.vertices
    middle = T[:3, :3] @ (vertices.min(axis=0) + vertices.max(axis=0)) / 2 + T[:3, 3]
    # The arrow that lies flattest in the picture; a step along it that is about a pixel there.
    axis = T[:3, int(np.linalg.norm(T[:2, :3], axis=0).argmax())]
    pixel = middle[2] * np.tan(client(app).camera.fov / 2) / (canvas_box(page)[3] / 2)

    def held() -> bool:
        grip, goal = (on_screen(page, app, middle + n * pixel * axis) for n in (76, 136))
        page.mouse.move(grip[0] + 2, grip[1] + 2)
        page.wait_for_timeout(400)
        page.mouse.move(*grip, steps=3)
        page.wait_for_timeout(400)
        page.mouse.down()
        page.mouse.move(*goal, steps=4)
        end = time.monotonic() + 5.0
        while time.monotonic() < end:
            if app.tabs()[-1].is_dragging:
                return True
            page.wait_for_timeout(50)
        page.mouse.up()
        return False

    # The gizmo is drawn a moment after the part; a pull before that moves nothing.
    until(held, "the gizmo is held")
    page.wait_for_timeout(500)
    page.mouse.up()
    kept = until(lambda: _of_gizmo(app, index, part), "the part is moved")
    assert kept.T_camera_part is not None
    shift = kept.T_camera_part[:3, 3] - T[:3, 3]
    assert shift @ axis == pytest.approx(60 * pixel, rel=0.15)
    assert np.linalg.norm(shift - (shift @ axis) * axis) < 2e-4
    assert kept.T_camera_part[:3, :3] == pytest.approx(T[:3, :3], abs=1e-5)
    return kept.T_camera_part


def _of_gizmo(app: App, index: int, part: str) -> PoseAnnotation | None:
    found = app.workspace.store.pose(index, part)
    return found if found and found.provenance == "gizmo" else None


def _placed(app: App, index: int, part: str) -> PoseAnnotation | None:
    found = app.workspace.store.pose(index, part)
    return found if found and found.T_camera_part is not None else None
