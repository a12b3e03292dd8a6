"""What the browser tests do over and over: open a page, wait, look at the canvas."""

from __future__ import annotations

import base64
import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
from playwright.sync_api import Browser, Page, expect

from asdfviz.app.main import App

PATIENCE = 120.0
"""Seconds that anything may take on a loaded machine; nothing waits that long for its own sake."""
SELDOM = """
const real = window.setInterval.bind(window);
window.setInterval = (work, delay, ...rest) => real(work, delay === 1000 ? 10000 : delay, ...rest);
"""
"""viser draws every second though nothing has changed, which keeps a processor busy without a GPU."""
expect.set_options(timeout=1000 * PATIENCE)


def until(condition: Callable[[], Any], what: str) -> Any:
    """Wait for a condition, which a loaded machine may delay."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError(f"{what}: did not happen within {PATIENCE:.0f} s")


@contextlib.contextmanager
def opened(chromium: Browser, app: App, *, size: tuple[int, int] = (1280, 800)) -> Iterator[Page]:
    """A page of the app that has its first frame, the welcome card closed."""
    context = chromium.new_context(viewport={"width": size[0], "height": size[1]})
    page = context.new_page()
    page.set_default_timeout(1000 * PATIENCE)
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.add_init_script(SELDOM)
    page.goto(f"{app.url}?fixedDpr=1")
    page.get_by_test_id("welcome-close").click()
    expect(page.get_by_test_id("welcome")).to_be_hidden(timeout=1000 * PATIENCE)
    # viser tells of the software renderer of a headless browser, over the picture.
    page.add_style_tag(content=".mantine-Notifications-root { display: none !important; }")
    yield page
    context.close()
    assert errors == []


def view(app: App) -> Any:
    """The view of the tab that is open."""
    return until(app.tabs, "a tab opens")[-1].view


def client(app: App) -> Any:
    return app.tabs()[-1].client


def canvas(page: Page) -> np.ndarray:
    """What WebGL drew, without anything that lies over it."""
    url = page.evaluate("() => window.__viserMutable.canvas.toDataURL('image/png')")
    data = np.frombuffer(base64.b64decode(url.split(",")[1]), np.uint8)
    bgr = cv2.imdecode(data, cv2.IMREAD_COLOR)
    assert bgr is not None
    return bgr[:, :, ::-1].astype(int)


def canvas_box(page: Page) -> Any:
    return page.evaluate(
        "() => { const b = window.__viserMutable.canvas.getBoundingClientRect();"
        " return [b.left, b.top, b.width, b.height]; }"
    )


def on_screen(page: Page, app: App, point: np.ndarray) -> tuple[float, float]:
    """Where a point (metres, camera frame) is seen in the window while nothing is magnified."""
    left, top, width, height = canvas_box(page)
    scale = height / 2 / np.tan(client(app).camera.fov / 2)
    return (
        left + width / 2 + scale * point[0] / point[2],
        top + height / 2 + scale * point[1] / point[2],
    )


def settled(page: Page, is_there: Callable[[np.ndarray], bool]) -> np.ndarray:
    """The canvas once it shows what it should and no longer changes."""
    last = canvas(page)
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        time.sleep(0.3)
        now = canvas(page)
        if is_there(now) and now.shape == last.shape and np.array_equal(now, last):
            return now
        last = now
    raise AssertionError("the picture did not settle")


def magenta(rgb: np.ndarray) -> np.ndarray:
    r, g, b = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    return (r > 1.7 * g + 25) & (b > 1.7 * g + 25)


def green(rgb: np.ndarray) -> np.ndarray:
    r, g, b = rgb[..., 0], rgb[..., 1], rgb[..., 2]
    return (g > 1.7 * r + 25) & (g > 1.7 * b + 25)


def blobs(mask: np.ndarray) -> np.ndarray:
    """Centres of the four largest spots, in pixels, sorted by place."""
    _, _, stats, centres = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    order = np.argsort(-stats[1:, cv2.CC_STAT_AREA])[:4] + 1
    found = centres[order]
    return found[np.lexsort((found[:, 0], found[:, 1] > found[:, 1].mean()))]


def count(mask: np.ndarray) -> int:
    """How many spots of more than a dozen pixels there are."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    return int((stats[1:, cv2.CC_STAT_AREA] > 12).sum())


def turn(page: Page, testid: str, *, on: bool) -> None:
    """Press a switch until it stands as wished."""
    switch = page.get_by_test_id(testid)
    if switch.get_attribute("aria-pressed") != str(on).lower():
        switch.click()
    expect(switch).to_have_attribute("aria-pressed", str(on).lower())
