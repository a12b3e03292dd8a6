"""The report page in a real browser: nothing loaded, nothing cut off, readable in light and dark."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest
from playwright.sync_api import Browser

from asdfviz.evaluate.report import write_report

pytestmark = pytest.mark.browser

# WCAG's contrast of every text against what lies behind it; the page has plain backgrounds only.
CONTRAST = """() => {
  const lum = c => { const v = c.map(x => x / 255).map(x => x <= .04045 ? x / 12.92 : ((x + .055) / 1.055) ** 2.4);
    return .2126 * v[0] + .7152 * v[1] + .0722 * v[2]; };
  const parse = s => s.match(/[\\d.]+/g).map(Number);
  let worst = 21;
  for (const e of document.querySelectorAll('h1,h2,h3,p,th,td,a,figcaption,summary,.legend span,footer,.strip>b')) {
    let behind = e; while (behind && parse(getComputedStyle(behind).backgroundColor)[3] === 0) behind = behind.parentElement;
    const back = getComputedStyle(behind || document.body).backgroundColor;
    if (!back.startsWith('rgb')) continue;
    const [a, b] = [lum(parse(getComputedStyle(e).color)), lum(parse(back))].sort((x, y) => y - x);
    worst = Math.min(worst, (a + .05) / (b + .05));
  }
  return worst; }"""


@pytest.fixture(scope="module")
def page_file(scene_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("report") / "report.html"
    write_report([scene_folder / "runs" / "asdf"], out, pictures=2)
    return out


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 400])
def test_the_page_stands_alone(
    scheme: Literal["light", "dark"], width: int, chromium: Browser, page_file: Path
) -> None:
    context = chromium.new_context(
        viewport={"width": width, "height": 800}, color_scheme=scheme, offline=True
    )
    page = context.new_page()
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    complaints: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.goto(page_file.as_uri())
    assert [url for url in asked if not url.startswith(("file:", "data:"))] == []
    assert complaints == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.evaluate("[...document.images].every(i => i.naturalWidth === 480)")
    assert page.evaluate("document.images.length") == 2
    assert page.evaluate(CONTRAST) >= 4.5
    strip = page.locator(".bar").first.bounding_box()
    boxes = [box.bounding_box() for box in page.locator(".bar").first.locator("i").all()]
    assert strip is not None
    widths = [box["width"] for box in boxes if box is not None]
    assert sum(widths) == pytest.approx(strip["width"], abs=1)
    assert max(widths) - min(widths) <= 1  # three states of four frames each
    context.close()
