"""Makes the README's picture of synthetic images: `python tests/looks/make_contact_sheet.py OUT.jpg`.

Twelve tiles of our own assemblies: scenes, packs, hands, error states and depth. Every tile has its
own seed, so the picture can be made again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from asdfviz.data.assembly import load_assembly
from asdfviz.geometry.shapes import Depth, Rgb
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.depth_sensor import DepthSensor, measure_depth
from asdfviz.synth.packs import PackConfig, draw_pack
from asdfviz.synth.render import Picture, render
from asdfviz.synth.scene import SceneConfig, make_scene
from asdfviz.synth.sensor import photograph, random_rgb_sensor

TILE = (426, 240)
DRAWN = (852, 480)
NEAR = SceneConfig(*DRAWN, distance=(0.4, 0.46), tilt=(0.0, 0.5), stray=0.0)
QUIET = replace(NEAR, held=0.0, passing_hand=0.0)
HELD = replace(NEAR, held=1.0, hand_when_held=1.0)


@cache
def assets_of(name: str, *, only: str = "all") -> Assets:
    """An assembly with all its states, or only its errors or its finished state."""
    assembly = load_assembly(name)
    if only == "errors":
        assembly = replace(assembly, states=assembly.errors)
    if only == "finished":
        assembly = replace(assembly, states=assembly.steps[-1:])
    return load_assets(assembly)


def scene(name: str, seed: int, config: SceneConfig, *, only: str = "all") -> tuple[Rgb, Picture]:
    """A photographed scene and what is behind it."""
    assets, rng = assets_of(name, only=only), np.random.default_rng(seed)
    drawn = make_scene(assets, rng=rng, config=config)
    picture = render([drawn.scene], assets.bank, rng=rng, supersampling=1.5)[0]
    return photograph(picture.radiance, sensor=random_rgb_sensor(rng), rng=rng), picture


def pack(name: str, seed: int) -> Rgb:
    """A photographed pack."""
    config = PackConfig(*DRAWN, sizes_px=(45.0, 160.0))
    return draw_pack(assets_of(name), rng=np.random.default_rng(seed), config=config)[0]


def depth_tile(name: str, seed: int, config: SceneConfig, *, only: str = "all") -> Rgb:
    """The depth of a scene as the sensor gives it, near bright and far dark, black for none."""
    _, picture = scene(name, seed, config, only=only)
    rng = np.random.default_rng(seed)
    depth = measure_depth(picture.depth, picture.albedo, sensor=DepthSensor(), rng=rng)
    return shades(depth)


def shades(depth: Depth) -> Rgb:
    """Depth as colours between its 1st and 97th percentile."""
    known = depth[depth > 0]
    low, high = np.percentile(known, [1, 97])
    share = np.clip((high - depth) / max(high - low, 1e-6), 0, 1)
    bgr = cv2.applyColorMap((40 + 200 * share).astype(np.uint8), cv2.COLORMAP_VIRIDIS)
    return np.where((depth > 0)[:, :, None], bgr[:, :, ::-1], 0).astype(np.uint8)


TILES: tuple[tuple[str, Callable[[], Rgb]], ...] = (
    ("scene, vise", lambda: scene("vise", 1, QUIET, only="finished")[0]),
    ("scene, corner clamp", lambda: scene("corner_clamp", 2, HELD)[0]),
    ("scene, geared caliper", lambda: scene("geared_caliper", 3, QUIET)[0]),
    ("scene, screw clamp", lambda: scene("screw_clamp", 4, HELD, only="finished")[0]),
    ("error, vise", lambda: scene("vise", 5, NEAR, only="errors")[0]),
    ("error, corner clamp", lambda: scene("corner_clamp", 6, QUIET, only="errors")[0]),
    ("error, geared caliper", lambda: scene("geared_caliper", 7, NEAR, only="errors")[0]),
    ("error, screw clamp", lambda: scene("screw_clamp", 8, NEAR, only="errors")[0]),
    ("pack, vise", lambda: pack("vise", 9)),
    ("pack, screw clamp", lambda: pack("screw_clamp", 10)),
    ("depth of the first", lambda: depth_tile("vise", 1, QUIET, only="finished")),
    ("depth of the second", lambda: depth_tile("corner_clamp", 2, HELD)),
)


def main(out: Path) -> None:
    """Write the sheet as JPEG."""
    tiles: list[np.ndarray] = []
    for title, make in TILES:
        tile = cv2.resize(make(), TILE, interpolation=cv2.INTER_AREA)
        tile[-22:] //= 3
        font, white = cv2.FONT_HERSHEY_SIMPLEX, (255, 255, 255)
        cv2.putText(tile, title, (8, TILE[1] - 7), font, 0.45, white, 1, cv2.LINE_AA)
        tiles.append(tile)
    sheet = np.vstack([np.hstack(tiles[i : i + 4]) for i in range(0, len(tiles), 4)])
    cv2.imwrite(str(out), sheet[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main(Path(sys.argv[1]))
