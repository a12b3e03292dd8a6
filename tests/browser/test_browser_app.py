"""The app as a person meets it, in a headless browser: open, look, play, run, pick, nudge, undo, judge."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from browser_steps import (
    blobs,
    canvas_box,
    client,
    count,
    green,
    magenta,
    on_screen,
    opened,
    settled,
    turn,
    until,
    view,
)
from playwright.sync_api import Browser, Page, expect

from asdfviz.app import main
from asdfviz.app.main import App, ViewConfig, open_app
from asdfviz.app.resuming import kept
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.registry import find_method

# A tab that closes while it is being drawn makes viser warn of the last message.
pytestmark = [
    pytest.mark.browser,
    pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection"),
]
METHOD = '''
"""A method for the test: looks at nothing, takes its time until a file appears."""
import time
from dataclasses import dataclass
from pathlib import Path
import numpy as np
from asdfviz.datatypes import FramePrediction, PoseEstimate
from asdfviz.methods.spec import MethodSpec

@dataclass(frozen=True)
class Config:
    distance: float = 0.5
    """Where it says that the base is, metres."""

class Patient:
    def __init__(self, config):
        self.distance = config.distance
    def reset(self, assembly, camera, initial):
        self.seen = 0
    def step(self, frame):
        self.seen += 1
        while self.seen == 3 and not Path(__file__).with_suffix(".go").exists():
            time.sleep(0.02)
        T = np.eye(4)
        T[2, 3] = self.distance
        return FramePrediction(frame.index, {"base": PoseEstimate("base", T, 1.0, "pnp")}, None)

SPEC = MethodSpec("patient", "Waits.", Config, "patient:Patient")
'''


@pytest.fixture(scope="module")
def method_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("method") / "patient.py"
    file.write_text(METHOD)
    return file


@pytest.fixture(scope="module")
def annotation_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("annotations")


@pytest.fixture(scope="module")
def app(scene_folder: Path, annotation_folder: Path, method_file: Path) -> Iterator[App]:
    name = f"{method_file}:SPEC"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(main, "available_methods", lambda: {name: find_method(name)})
        running = open_app(
            ViewConfig(
                sequence=str(scene_folder), annotations=annotation_folder, author="ann", port=0
            )
        )
        yield running
        running.close()


@pytest.fixture(scope="module")
def page(chromium: Browser, app: App) -> Iterator[Page]:
    with opened(chromium, app) as made:
        yield made


def test_it_opens_with_the_first_frame_and_its_poses(page: Page, app: App) -> None:
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "0")
    expect(page.get_by_test_id("sequence")).to_have_text("desk")
    expect(page.get_by_test_id("state")).to_contain_text(app.workspace.assembly.states[0].name)
    for row in ("annotation", "truth"):
        expect(page.get_by_test_id(f"tl-{row}")).to_be_visible()
    expect(page.get_by_test_id("health")).not_to_contain_text("Checking")
    # The mesh of the base lies over the grey picture, in its own colour.
    u, v = on_screen(page, app, np.array([-0.056, 0.0, 0.5]))
    left, top, _, _ = canvas_box(page)
    at = (round(v - top), round(u - left))
    settled(page, lambda rgb: bool(np.ptp(rgb[at]) > 25))


@pytest.mark.parametrize("size", [(1280, 800), (1000, 900)])
def test_meshes_lie_on_the_picture_to_half_a_pixel(
    page: Page, app: App, marks: np.ndarray, size: tuple[int, int]
) -> None:
    """Painted discs and balls in space at the same points have the same centres on the screen."""
    page.set_viewport_size({"width": size[0], "height": size[1]})
    left, top, width, height = canvas_box(page)
    until(lambda: abs(view(app).aspect - width / height) < 0.01, "the view follows the window")
    turn(page, "toggle-overlay", on=False)
    discs = blobs(green(settled(page, lambda rgb: count(green(rgb)) == 4)))
    balls = [
        client(app).scene.add_icosphere(
            f"/test/{i}",
            radius=0.012 * z,
            color=(255, 0, 255),
            subdivisions=3,
            position=(x, y, z),
            cast_shadow=False,
            receive_shadow=False,
        )
        for i, (x, y, z) in enumerate(marks)
    ]
    try:
        found = blobs(magenta(settled(page, lambda rgb: count(magenta(rgb)) == 4)))
    finally:
        for ball in balls:
            ball.remove()
        turn(page, "toggle-overlay", on=True)
    errors = np.linalg.norm(found - discs, axis=1)
    assert errors.max() <= 0.5, errors
    # And both lie where the pinhole model puts them.
    expected = np.array([on_screen(page, app, mark) for mark in marks]) - [left + 0.5, top + 0.5]
    expected = expected[np.lexsort((expected[:, 0], expected[:, 1] > expected[:, 1].mean()))]
    assert np.linalg.norm(found - expected, axis=1).max() <= 0.5


@pytest.mark.parametrize("last", ["11", "1999", "1234567"])
@pytest.mark.parametrize("size", [(1600, 900), (1280, 800), (1000, 900)])
def test_no_control_covers_another(page: Page, size: tuple[int, int], last: str) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    boxes = page.evaluate(
        """(last) => {
            const numbers = [...document.querySelector('.ax-frame').children];
            const before = numbers.map(e => e.textContent);
            [last, ` / ${last}`].forEach((said, i) => { numbers[i].textContent = said; });
            const boxes = [document.querySelector('.ax-bottom'),
                ...document.querySelectorAll('.ax-controls .ax-btn, .ax-frame, .ax-opacity')].map(e => {
                const b = e.getBoundingClientRect();
                return [b.left, b.top, b.right, b.bottom];
            });
            before.forEach((said, i) => { numbers[i].textContent = said; });
            return boxes;
        }""",
        last,
    )
    (left, _, right, _), *controls = boxes
    assert len(controls) > 10
    for i, a in enumerate(controls):
        assert left <= a[0]
        assert a[2] <= right
        for b in controls[:i]:
            apart = a[0] >= b[2] or b[0] >= a[2] or a[1] >= b[3] or b[1] >= a[3]
            assert apart, (a, b)


@pytest.mark.parametrize(
    ("width", "name", "is_whole", "tells_who"),
    [
        (1600, "jaw on", True, True),
        (1280, "jaw on", True, True),
        (1280, "clamping nut", True, False),
        (1280, "clamping nut on the spindle", False, False),
        (1000, "jaw on", True, False),
        (800, "jaw on", True, False),
    ],
)
def test_the_state_is_not_cut_in_a_letter_while_a_method_runs(
    page: Page, width: int, name: str, *, is_whole: bool, tells_who: bool
) -> None:
    page.set_viewport_size({"width": width, "height": 800})
    found = page.evaluate(
        """(name) => {
            const bar = document.querySelector('.ax-bar-main').cloneNode(true);
            document.querySelector('.ax-top').prepend(bar);
            document.querySelector('.ax-bar-main ~ .ax-bar-main').style.display = 'none';
            bar.querySelector('.ax-name').textContent = 'sequence';
            const state = bar.querySelector('.ax-state'), [said, who] = state.children;
            said.lastChild.textContent = name;
            who.textContent = 'annotation';
            bar.querySelector('.ax-tools').insertAdjacentHTML('afterbegin', `<span class="ax-job">
                <span class="ax-meter"></span><span>Running asdf_track: 1234/1999, 2525 ms a frame</span></span>
                <span class="ax-btn">Stop</span>`);
            const box = (e) => e.getBoundingClientRect(), inside = box(state).bottom > box(who).top + 4;
            const all = [...bar.querySelectorAll('.ax-btn')].every((e) => box(e).right <= box(bar).right);
            const told = [said.scrollWidth <= said.clientWidth, getComputedStyle(said).textOverflow, inside, all];
            bar.remove();
            document.querySelector('.ax-bar-main').style.display = '';
            return told;
        }""",
        name,
    )
    assert found == [is_whole, "ellipsis", tells_who, True]


@pytest.mark.parametrize("size", [(1600, 900), (1280, 800)])
def test_nothing_overlaps(page: Page, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    boxes = page.evaluate(
        """() => Object.fromEntries(Object.entries({
            top: '.ax-bar-main', tabs: '.ax-tabs', bottom: '.ax-bottom',
            panel: '[data-dock-region]', picture: '[data-asdf="canvas"]',
        }).map(([name, query]) => {
            const b = document.querySelector(query).getBoundingClientRect();
            return [name, [b.left, b.top, b.right, b.bottom]];
        }))"""
    )
    names = list(boxes)
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            (l0, t0, r0, b0), (l1, t1, r1, b1) = boxes[a], boxes[b]
            across = min(r0, r1) - max(l0, l1)
            down = min(b0, b1) - max(t0, t1)
            assert min(across, down) <= 1.5, (a, b, boxes)
    # No control is squeezed out of its bar.
    outside = page.evaluate(
        """() => [...document.querySelectorAll('.ax-top, .ax-bottom')].flatMap((bar) => {
            const o = bar.getBoundingClientRect();
            return [...bar.querySelectorAll('.ax-btn, input, .ax-frame')].filter((e) => {
                const b = e.getBoundingClientRect();
                return b.width && (b.left < o.left - 1 || b.right > o.right + 1 || b.bottom > o.bottom + 1);
            }).map((e) => e.textContent || e.tagName);
        })"""
    )
    assert outside == []


def test_play_pause_step_and_seek(page: Page, app: App) -> None:
    frame = page.get_by_test_id("frame")
    page.keyboard.press("Home")
    expect(frame).to_have_attribute("data-place", "0")
    page.keyboard.press("ArrowRight")
    expect(frame).to_have_attribute("data-place", "1")
    page.keyboard.press("PageDown")
    expect(frame).to_have_attribute("data-place", "4")
    page.keyboard.press("Space")
    until(lambda: view(app).place >= 6, "it plays")
    page.keyboard.press("Space")
    until(lambda: not view(app).playing, "it pauses")
    strip = page.get_by_test_id("tl-truth").locator(".tl-strip").bounding_box()
    assert strip is not None
    y = strip["y"] + 5

    def at(place: int) -> float:
        return strip["x"] + strip["width"] * (place + 0.5) / len(app.workspace.indices)

    page.mouse.click(at(2), y)
    expect(frame).to_have_attribute("data-place", "2")
    page.mouse.move(at(3), y)
    page.mouse.down()
    page.mouse.move(at(9), y, steps=6)
    page.mouse.up()
    expect(frame).to_have_attribute("data-place", "9")
    frame.click()
    page.get_by_test_id("frame-number").fill(str(app.workspace.indices[3]))
    page.keyboard.press("Enter")
    expect(frame).to_have_attribute("data-place", "3")
    frame.click()
    page.get_by_test_id("frame-number").fill("900000")  # there is none: the nearest is the last
    page.keyboard.press("Enter")
    expect(frame).to_have_attribute("data-place", str(len(app.workspace.indices) - 1))
    page.mouse.click(at(9), y)
    expect(frame).to_have_attribute("data-place", "9")
    # The picture shown is that of the frame: each is 8 levels lighter than the one before.
    settled(page, lambda rgb: abs(int(np.median(rgb[:, :, 0])) - (40 + 8 * 9)) <= 2)


def test_a_page_in_which_nothing_changes_asks_for_no_drawing(page: Page) -> None:
    """Without a GPU, drawing what has not changed takes a whole processor."""
    page.evaluate("""() => {
        const mutable = window.__viserMutable, real = mutable.requestRender;
        window.asked = 0;
        mutable.requestRender = () => { window.asked += 1; real(); };
    }""")

    def asked_while_idle() -> int:
        before = page.evaluate("() => window.asked")
        page.wait_for_timeout(1500)
        return page.evaluate("() => window.asked") - before

    until(lambda: asked_while_idle() == 0, "it comes to rest")


def test_the_cursor_hides_no_label_that_begins_at_it(page: Page) -> None:
    page.evaluate("() => window.asdfviz.send({ kind: 'Seek', place: 4 })")
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "4")
    cursor = page.locator('[data-testid="tl-truth"] .tl-cursor').bounding_box()
    label = page.locator('[data-testid="tl-truth"] [data-first="4"] em')
    left = label.evaluate(
        "(em) => { const text = document.createRange(); text.selectNodeContents(em);"
        " return text.getBoundingClientRect().left; }"
    )
    assert cursor is not None
    assert left > cursor["x"] + cursor["width"]
    page.keyboard.press("Home")


def test_zoom_and_the_3d_view_and_back(page: Page, app: App) -> None:
    left, top, width, height = canvas_box(page)
    page.mouse.move(left + width * 0.3, top + height * 0.4)
    page.mouse.wheel(0, -400)
    until(lambda: view(app).zoom > 1.5, "the wheel magnifies")
    page.get_by_test_id("zoom").click()
    until(lambda: view(app).zoom == 1.0, "the whole picture is back")
    page.keyboard.press("t")
    until(lambda: np.linalg.norm(client(app).camera.position) > 0.05, "the camera is free")
    page.keyboard.press("t")
    until(lambda: np.linalg.norm(client(app).camera.position) < 1e-4, "the camera is pinned")
    until(lambda: page.evaluate("() => window.asdfviz.view.mode") == "ar", "the page knows it")
    # Keys that fly viser's camera do nothing here.
    page.keyboard.down("w")
    page.keyboard.down("d")
    page.wait_for_timeout(300)
    page.keyboard.up("w")
    page.keyboard.up("d")
    assert np.linalg.norm(client(app).camera.position) < 1e-4


def test_a_method_runs_shows_its_progress_and_can_be_stopped(
    page: Page, app: App, method_file: Path
) -> None:
    go = method_file.with_suffix(".go")
    page.get_by_test_id("tab-methods").click()
    run = page.get_by_test_id(f"run-{method_file}:SPEC")
    run.click()
    expect(page.get_by_test_id("job-panel")).to_contain_text(re.compile("Running patient: [12]/12"))
    expect(page.get_by_test_id("job")).to_contain_text("/12")
    page.get_by_test_id("stop").click()
    until(lambda: app.workspace.job and app.workspace.job.state == "stopping", "it is told")
    go.touch()
    expect(page.get_by_test_id("job-end")).to_contain_text("stopped after 3 of 12")
    run.click()
    expect(page.get_by_test_id("job-end")).to_contain_text("patient is done: 12 frames")
    expect(page.get_by_test_id("runs")).to_contain_text("patient 2")
    folders = {run.folder for run in app.workspace.runs}
    assert all(folder and (folder / "run.json").is_file() for folder in folders)
    page.get_by_test_id("eye-patient 2").click()
    until(lambda: len(view(app).layers) == 1, "its outlines are on")
    page.keyboard.press("3")
    until(lambda: not view(app).layers, "a number key takes them off")


def test_a_method_runs_with_the_options_that_were_chosen(
    page: Page, app: App, method_file: Path
) -> None:
    method_file.with_suffix(".go").touch()
    page.get_by_test_id("tab-methods").click()
    page.get_by_test_id(f"options-{method_file}:SPEC").click()
    form = page.get_by_test_id("options")
    expect(form).to_contain_text("Where it says that the base is, metres.")
    distance = form.locator('[data-option="distance"]')
    expect(distance).to_have_value("0.5")
    before = len(app.workspace.runs)
    # What cannot be read is said, and the form stays as it is.
    distance.fill("far")
    page.get_by_test_id("options-run").click()
    expect(page.get_by_text("distance is 'far': give a number")).to_be_attached()
    expect(distance).to_have_value("far")
    distance.fill("0.75")
    distance.press("Enter")
    expect(form).to_be_hidden()
    expect(page.get_by_test_id("job-end")).to_contain_text("patient is done: 12 frames")
    until(lambda: len(app.workspace.runs) == before + 1, "one more run is there")
    assert app.workspace.runs[-1].run.predictions[0].poses["base"].T_camera_part[2, 3] == 0.75
    expect(page.get_by_test_id("runs")).to_contain_text("distance 0.75")
    expect(page.get_by_test_id(f"options-{method_file}:SPEC")).to_have_text("Options (1)")


def test_a_part_is_picked_nudged_and_taken_back(page: Page, app: App) -> None:
    page.keyboard.press("Home")
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "0")
    jaw = app.workspace.assembly.parts["jaw"].mesh
    T = app.workspace.poses(0, view(app).base)["jaw"].T_camera_part
    face = jaw.vertices[jaw.faces].mean(axis=1) @ T[:3, :3].T + T[:3, 3]
    u, v = on_screen(page, app, face[face[:, 2].argmin()])

    def picked() -> bool:
        # The first ray after a change of the scene may come before the mesh is there.
        page.mouse.move(u - 3, v)
        page.mouse.move(u, v, steps=3)
        page.wait_for_timeout(200)
        page.mouse.click(u, v)
        page.wait_for_timeout(300)
        return view(app).selected == "jaw"

    until(picked, "the jaw is picked")
    expect(page.get_by_test_id("part-jaw")).to_have_attribute("aria-selected", "true")
    page.keyboard.press("l")
    moved = until(lambda: app.workspace.store.pose(0, "jaw"), "the nudge is kept")
    assert moved.T_camera_part[:3, 3] - T[:3, 3] == pytest.approx([0.001, 0, 0], abs=1e-12)
    expect(page.get_by_test_id("status")).to_contain_text("saved")
    expect(page.get_by_test_id("part-jaw")).to_contain_text("corrected")
    page.keyboard.press("0")
    page.keyboard.press("Shift+o")
    until(lambda: len(app.workspace.store.history()) == 3, "the turn is kept")
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    until(lambda: app.workspace.store.pose(0, "jaw") is None, "both are taken back")
    page.keyboard.press("Control+Shift+z")
    until(lambda: app.workspace.store.pose(0, "jaw") is not None, "one is done again")
    page.keyboard.press("Escape")


def test_a_pose_is_typed_and_wrong_figures_are_told(page: Page, app: App) -> None:
    def x_mm() -> float:
        return 1000 * app.workspace.poses(0, view(app).base)["jaw"].T_camera_part[0, 3]

    page.keyboard.press("Home")
    page.get_by_test_id("tab-annotate").click()
    page.get_by_test_id("part-jaw").click()
    before, field = x_mm(), page.get_by_test_id("pose-x")
    field.fill("61.5")
    field.press("Enter")
    until(lambda: x_mm() == pytest.approx(61.5), "the figure is taken")
    expect(field).to_have_value("61.5")
    field.fill("no kilometre")
    field.press("Enter")
    told = page.locator(".mantine-Notifications-root").filter(has_text="'no kilometre' is no x")
    expect(told).to_be_attached()
    expect(field).to_have_value("61.5")
    field.fill("5")
    field.press("Escape")
    expect(field).to_have_value("61.5")
    page.keyboard.press("Control+z")
    until(lambda: x_mm() == pytest.approx(before), "it is taken back")
    page.keyboard.press("Escape")


def edited(app: App) -> list[int]:
    """Frames of all edits of poses and states; the first of all keeps what it started from, too."""
    return [edit.frame for edit in app.workspace.store.history() if edit.frame is not None]


def test_figures_go_to_the_frame_in_which_typing_began(page: Page, app: App) -> None:
    page.keyboard.press("Home")
    page.get_by_test_id("tab-annotate").click()
    page.get_by_test_id("part-jaw").click()
    edits = len(edited(app))
    page.get_by_test_id("pose-x").click()
    # As where playing stops late: a later frame's panel comes before the one that is held.
    page.evaluate(
        """() => {
        const typed = document.querySelector("[data-typed]").dataset;
        typed.typed = JSON.stringify({...JSON.parse(typed.typed), place: 3});
    }"""
    )
    page.keyboard.type("61.5")
    page.keyboard.press("Tab")
    page.keyboard.type("12")
    page.keyboard.press("Enter")
    until(lambda: len(edited(app)) == edits + 2, "both are kept")
    assert set(edited(app)[edits:]) == {app.workspace.indices[0]}
    assert view(app).place == 0
    for _ in range(2):
        page.keyboard.press("Control+z")
    page.keyboard.press("Escape")


def test_what_is_half_typed_survives_what_the_server_renews(page: Page, app: App) -> None:
    page.keyboard.press("Home")
    page.get_by_test_id("tab-annotate").click()
    page.get_by_test_id("part-jaw").click()
    edits, step = len(edited(app)), view(app).step
    page.keyboard.press("Space")  # every frame that is played renews the panel
    until(lambda: view(app).playing, "it plays")
    page.get_by_test_id("pose-x").click()
    until(lambda: not view(app).playing, "it pauses")
    place = view(app).place

    def posed() -> Transform:
        return app.workspace.poses(place, view(app).base)["jaw"].T_camera_part

    T_before = posed()  # in the first frame a correction of before
    page.keyboard.type("61.5")
    page.keyboard.press("Tab")
    page.keyboard.type("1", delay=300)  # meanwhile the answer to x comes
    page.keyboard.type("2", delay=300)
    page.keyboard.press("Enter")
    until(lambda: len(edited(app)) == edits + 2, "both are kept")
    assert 1000 * posed()[:2, 3] == pytest.approx([61.5, 12.0])
    assert view(app).step == step  # no figure was taken for a key
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    until(lambda: np.array_equal(posed(), T_before), "both are taken back")
    page.keyboard.press("Home")
    page.keyboard.press("Space")
    until(lambda: view(app).place >= 1, "it plays")
    page.get_by_test_id("frame").click()
    until(lambda: not view(app).playing, "it pauses")
    page.get_by_test_id("frame-number").fill(str(app.workspace.indices[5]))
    page.keyboard.press("Tab")  # leaving the field takes it, too
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "5")
    page.keyboard.press("Escape")


def test_a_state_is_set_for_a_range(page: Page, app: App) -> None:
    page.get_by_test_id("tab-annotate").click()
    strip = page.get_by_test_id("tl-truth").locator(".tl-strip").bounding_box()
    assert strip is not None
    each = strip["width"] / 12
    frame = page.get_by_test_id("frame")
    for start, shown in ((9, 5), (4, 4)):  # outside of the range, and within it
        page.mouse.click(strip["x"] + (start + 0.5) * each, strip["y"] + 5)
        expect(frame).to_have_attribute("data-place", str(start))
        page.keyboard.down("Shift")
        page.mouse.move(strip["x"] + 2.5 * each, strip["y"] + 5)
        page.mouse.down()
        page.mouse.move(strip["x"] + 5.5 * each, strip["y"] + 5, steps=5)
        page.mouse.up()
        page.keyboard.up("Shift")
        expect(page.get_by_test_id("range")).to_contain_text("frames 2 to 5")
        expect(frame).to_have_attribute("data-place", str(shown))
        cursor = page.get_by_test_id("tl-truth").locator(".tl-cursor").bounding_box()
        assert cursor is not None
        middle = cursor["x"] + cursor["width"] / 2
        assert middle == pytest.approx(strip["x"] + (shown + 0.5) * each, abs=1)
    page.get_by_test_id("state-2").click()
    label = until(lambda: app.workspace.store.state(5), "the state is kept")
    assert (label.state, label.is_error) == (2, False)
    assert app.workspace.store.state(6) is None
    expect(page.get_by_test_id("tl-annotation").locator('[data-state="2"]')).to_be_visible()
    page.keyboard.press("Escape")


def test_results_judge_the_runs(page: Page) -> None:
    page.get_by_test_id("tab-results").click()
    page.get_by_test_id("judge").click()
    expect(page.get_by_test_id("report")).to_contain_text("4.0 mm")
    expect(page.get_by_test_id("worst")).to_be_visible()
    # A long name is broken, so that it pushes no figure out of the panel.
    beyond = page.locator(".ax-panel").evaluate(
        """(panel) => {
            panel.querySelectorAll("tr > :first-child").forEach((cell) => { cell.textContent = "NanoViseV2_CLAMP_".repeat(3); });
            return panel.scrollWidth - panel.clientWidth;
        }"""
    )
    assert beyond == 0


def test_what_is_wrong_is_told_in_the_browser(page: Page) -> None:
    page.add_style_tag(content=".mantine-Notifications-root { display: block !important; }")
    page.get_by_test_id("tab-annotate").click()
    page.keyboard.press("Shift+Backspace")
    expect(page.get_by_text("no part is selected")).to_be_visible()


def test_the_timeline_tells_verdicts_where_the_hand_is(page: Page, app: App) -> None:
    store = app.workspace.store
    pose = app.workspace.poses(3, app.workspace.runs[0].id)["jaw"].T_camera_part
    store.verify(3, "jaw", pose, provenance="method:asdf")
    app.workspace.changed()
    row = page.get_by_test_id("tl-annotation")
    expect(row.locator(".tl-verified")).to_be_visible()
    strip = row.locator(".tl-strip").bounding_box()
    assert strip is not None
    page.mouse.move(strip["x"] + strip["width"] * 3.5 / 12, strip["y"] + 5)
    tip = page.get_by_test_id("tip")
    expect(tip).to_contain_text("annotation \u00b7 frame 3")
    expect(tip).to_contain_text("verified: jaw")
    # Nothing that it lies in cuts it off.
    cut = tip.evaluate(
        """(tip) => {
            const t = tip.getBoundingClientRect();
            for (let e = tip.parentElement; e; e = e.parentElement) {
                const b = e.getBoundingClientRect();
                const inside = t.top >= b.top && t.bottom <= b.bottom && t.left >= b.left && t.right <= b.right;
                if (getComputedStyle(e).overflowY !== 'visible' && !inside) return e.className || e.tagName;
            }
            return t.width > 0 && t.top >= 0 ? '' : 'nothing is drawn';
        }"""
    )
    assert cut == ""
    overflow = """(timeline) => {
        timeline.querySelectorAll(`.tl-row:not([data-testid="tl-annotation"])`).forEach((row) => { row.hidden = true; });
        return timeline.scrollHeight - timeline.clientHeight;
    }"""
    assert page.get_by_test_id("timeline").evaluate(overflow) == 0
    store.undo()
    app.workspace.changed()
    expect(row.locator(".tl-verified")).to_have_count(0)


def test_the_state_places_what_it_joins(page: Page) -> None:
    lane = page.get_by_test_id("tl-poses")
    page.get_by_test_id("tab-annotate").click()
    page.evaluate("() => window.asdfviz.send({kind: 'Seek', place: 2})")
    page.get_by_test_id("part-jaw").click()
    expect(lane).to_have_attribute("data-row", "poses of jaw")
    page.get_by_test_id("state-2").click()
    page.keyboard.press("Shift+Enter")
    expect(page.get_by_test_id("status")).to_contain_text("jaw placed by the state in frame 2")
    expect(page.get_by_test_id("part-jaw")).to_contain_text("by the state")
    expect(lane.locator(".tl-pose-state")).to_have_attribute("data-first", "2")
    for _ in range(2):
        page.keyboard.press("Control+z")
    expect(lane.locator(".tl-pose-state")).to_have_count(0)
    page.keyboard.press("Escape")
    expect(lane).to_have_attribute("data-row", "poses")


def test_a_slider_gives_the_keyboard_back(page: Page, app: App) -> None:
    page.keyboard.press("Home")
    until(lambda: view(app).place == 0, "it is at the first frame")
    slider, before = page.get_by_test_id("opacity"), view(app).opacity
    box = slider.bounding_box()
    assert box is not None
    thumb = 16.0
    share = (before - 0.05) / 0.95
    at_thumb = (box["x"] + thumb / 2 + (box["width"] - thumb) * share, box["y"] + box["height"] / 2)
    page.mouse.move(*at_thumb)
    page.mouse.down()
    expect(slider).to_be_focused()
    page.mouse.up()
    expect(slider).not_to_be_focused()
    page.keyboard.press("ArrowRight")
    until(lambda: view(app).place == 1, "the key goes on by a frame")
    assert view(app).opacity == before
    # One that is drawn along changes, wherever the hand lets go.
    page.mouse.move(*at_thumb)
    page.mouse.down()
    page.mouse.move(box["x"] + 4, box["y"] - 80, steps=4)
    page.mouse.up()
    expect(slider).not_to_be_focused()
    until(lambda: view(app).opacity < before, "it is drawn thinner")
    slider.fill(str(before))


def test_keys_are_on_a_sheet(page: Page) -> None:
    page.keyboard.press("Home")
    page.keyboard.press("Shift+h")
    expect(page.get_by_test_id("keys")).to_contain_text("Nudge up, down, left, right")
    page.keyboard.press("End")
    page.keyboard.press("Escape")
    expect(page.get_by_test_id("keys")).to_be_hidden()
    for tab in ("results", "annotate"):  # wherever the last press was
        page.get_by_test_id(f"tab-{tab}").click()
        page.keyboard.press("?")
        expect(page.get_by_test_id("keys")).to_be_visible()
        page.keyboard.press("?")
        expect(page.get_by_test_id("keys")).to_be_hidden()
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "0")


def test_keys_are_for_the_palette_while_it_is_open(page: Page) -> None:
    page.keyboard.press("Home")
    page.keyboard.press("Control+k")
    search = page.locator("input.mantine-Spotlight-search")
    expect(search).to_be_focused()
    expect(page.get_by_text("Watch  (Shift+Page ↓)")).to_be_attached()
    expect(page.get_by_text("pagedown")).to_have_count(0)
    page.evaluate("() => document.activeElement.blur()")
    page.keyboard.press("End")
    expect(search).to_be_focused()
    page.keyboard.type("sheet")
    page.keyboard.press("Enter")
    expect(page.get_by_test_id("keys")).to_be_visible()
    expect(search).to_be_hidden()
    page.keyboard.press("Escape")
    expect(page.get_by_test_id("keys")).to_be_hidden()
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "0")


def test_a_lost_connection_comes_back_as_it_was(page: Page, app: App) -> None:
    page.keyboard.press("End")
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "11")
    before = app.tabs()
    app.drop_connections()
    until(lambda: app.tabs() and app.tabs() != before, "the page connects again")
    until(lambda: app.tabs()[-1].view.place == 11, "it is where it was")
    names = app.workspace.pages.others("")
    assert {tab.view.page for tab in (*before, *app.tabs())} <= names, "its steps are its own"
    expect(page.get_by_test_id("welcome")).to_be_hidden()
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "11")
    centre = "() => Math.hypot(...window.__viserMutable.camera.position.toArray())"
    until(lambda: page.evaluate(centre) < 1e-4, "the camera is pinned")
    settled(page, lambda rgb: count(green(rgb)) == 4)


def test_another_sequence_begins_at_its_first_frame(page: Page, app: App) -> None:
    page.keyboard.press("End")
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "11")
    page.evaluate("() => { window.asdfviz.sequence = 'another'; }")
    before = app.tabs()
    app.drop_connections()
    until(lambda: app.tabs() and app.tabs() != before, "the page connects again")
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "0")
    page.keyboard.press("ArrowRight")  # behind whatever the page asked for when it came back
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "1")


def test_a_page_that_is_loaded_again_is_where_it_was(page: Page, app: App) -> None:
    page.keyboard.press("End")
    page.keyboard.press("ArrowLeft")
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "10")
    page.keyboard.press("t")
    expect(page.get_by_test_id("view-3d")).to_have_attribute("aria-pressed", "true")
    before = app.tabs()[-1].view.page
    page.reload()
    expect(page.get_by_test_id("frame")).to_have_attribute("data-place", "10")
    expect(page.get_by_test_id("view-3d")).to_have_attribute("aria-pressed", "true")
    until(lambda: before in app.workspace.pages.others(""), "its steps are its own")
    until(lambda: np.linalg.norm(client(app).camera.position) > 0.05, "the camera is free")


@pytest.mark.parametrize("way", ["loaded again", "lost its connection"])
def test_a_page_that_comes_back_looks_as_it_did(page: Page, app: App, way: str) -> None:
    turn(page, "view-ar", on=True)
    page.get_by_test_id("tab-annotate").click()
    page.get_by_test_id("part-base").click()
    until(lambda: view(app).selected == "base", "a part is selected")
    turn(page, "toggle-xray", on=True)
    page.get_by_test_id("opacity").fill("0.3")
    page.get_by_test_id("step").click()
    left, top, width, height = canvas_box(page)
    # Beside the notice that a page shows where it draws without a GPU.
    page.mouse.move(left + 2 * width / 3, top + height / 3)
    page.mouse.wheel(0, -300)
    until(lambda: view(app).zoom > 1.2 and view(app).opacity == 0.3, "it is magnified")
    known = "() => window.asdfviz.view.kept"
    until(lambda: page.evaluate(known) == json.dumps(asdict(kept(view(app)))), "the page knows it")
    before = view(app)
    if way == "loaded again":
        page.reload()
    else:
        app.drop_connections()
    until(lambda: app.tabs() and view(app).page != before.page, "the page connects again")
    until(lambda: view(app).selected == "base", "it goes on")
    assert replace(kept(view(app)), page=before.page) == kept(before)
    expect(page.get_by_test_id("tab-annotate")).to_have_attribute("aria-selected", "true")
    expect(page.get_by_test_id("opacity")).to_have_value("0.3")
    fov = "() => window.__viserMutable.camera.fov"
    until(lambda: page.evaluate(fov) == pytest.approx(np.degrees(client(app).camera.fov)), "zoom")
