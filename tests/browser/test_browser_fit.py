"""How much of the app is in sight: the whole Annotate tab in a window of 800 pixels, and narrow windows."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path

import numpy as np
import pytest
from browser_steps import opened
from playwright.sync_api import Browser, expect

from asdfviz.app.main import ViewConfig, open_app
from asdfviz.geometry.transforms import transform_from

pytestmark = [
    pytest.mark.browser,
    pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection"),
]


def test_the_annotate_tab_of_nine_parts_needs_no_scrolling(
    chromium: Browser, scene_folder: Path, tmp_path: Path
) -> None:
    """With a part selected, its frames marked, and parts placed by the state: nothing is left out."""
    blank = tmp_path / "blank"
    for room in ("rgb", "depth"):
        shutil.copytree(scene_folder / room, blank / room)
    shutil.copy(scene_folder / "scene_camera.json", blank)
    config = ViewConfig(sequence=str(blank), assembly="vise", annotations=tmp_path, port=0)
    with contextlib.closing(open_app(config)) as app, opened(chromium, app) as page:
        workspace = app.workspace
        T = transform_from(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.5]))
        workspace.store.set_frames({i: {"body": T} for i in range(3)}, provenance="tracked")
        workspace.changed()
        page.evaluate("() => window.asdfviz.send({ kind: 'SetRange', first: 0, last: 2 })")
        page.get_by_test_id("state-3").click()
        expect(page.get_by_test_id("place-joined")).to_be_visible()
        page.keyboard.press("Shift+G")
        expect(page.get_by_test_id("status")).to_contain_text("placed by the state")
        page.get_by_test_id("part-body").click()
        page.evaluate("() => window.asdfviz.send({ kind: 'SetRange', first: 0, last: 2 })")
        expect(page.get_by_test_id("range")).to_contain_text("frames 0 to 2")
        assert len(workspace.assembly.parts) == 9
        last = page.get_by_test_id(f"state-{len(workspace.assembly.states) - 1}")
        for shown in (page.get_by_test_id("undo"), page.get_by_test_id("track-forward"), last):
            expect(shown).to_be_in_viewport(ratio=1)


def test_a_narrow_window_shows_the_state_and_the_panel(
    chromium: Browser, scene_folder: Path, tmp_path: Path
) -> None:
    config = ViewConfig(sequence=str(scene_folder), annotations=tmp_path, port=0)
    size = (680, 800)
    with (
        contextlib.closing(open_app(config)) as app,
        opened(chromium, app, size=size) as page,
    ):
        page.get_by_test_id("tab-annotate").click()
        for name in ("state", "view-3d", "undo", "play", "tl-truth", "tab-results"):
            expect(page.get_by_test_id(name)).to_be_in_viewport(ratio=0.9)
