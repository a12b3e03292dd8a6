"""Makes a picture of the app: `python tests/browser/make_screenshot.py OUT.png [SEQUENCE] [ASSEMBLY]`.

It opens the app on the bundled sample (or another sequence) in a headless Chromium and waits for the
first run, so that the README's picture is made by the program and can be made again.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from asdfviz.app.main import App, ViewConfig, open_app

SIZE = {"width": 1600, "height": 900}
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SECONDS = 300.0


def main(out: Path, sequence: str = "sample", assembly: str | None = None) -> None:
    """Open the app, go to the middle of the sequence, select a part, and keep what is seen."""
    path = os.environ.get("CHROMIUM") or shutil.which("chromium")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        app = open_app(
            ViewConfig(sequence=sequence, assembly=assembly, annotations=Path(folder), port=0)
        )
        browser = playwright.chromium.launch(executable_path=path, args=FLAGS, headless=True)
        page = browser.new_context(viewport=SIZE).new_page()  # pyright: ignore[reportArgumentType]
        page.set_default_timeout(1000 * SECONDS)
        page.goto(f"{app.url}?fixedDpr=1")
        page.get_by_test_id("welcome-close").click()
        page.add_style_tag(content=".mantine-Notifications-root { display: none !important; }")
        end = time.monotonic() + SECONDS
        while _is_busy(app) and time.monotonic() < end:
            page.wait_for_timeout(500)
        middle = len(app.workspace.indices) * 2 // 3
        page.evaluate(f"() => window.asdfviz.send({{kind: 'Seek', place: {middle}}})")
        page.get_by_test_id("tab-annotate").click()
        page.keyboard.press("n")
        page.wait_for_timeout(8000)
        page.screenshot(path=str(out))
        browser.close()
        app.close()


def _is_busy(app: App) -> bool:
    job = app.workspace.job
    return app.workspace.findings is None or (job is not None and job.is_active)


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:4])
