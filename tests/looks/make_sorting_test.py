"""Makes a sorting test: `python tests/looks/make_sorting_test.py OUT REAL_FOLDER ASSEMBLY SEED`.

Twenty crops of synthetic frames among twenty of real ones, at random places over the covered table (with
as much cloth in both), shuffled and numbered, as two sheets (OUT/sheet_1.png, OUT/sheet_2.png) and as
single files; OUT_key.txt beside the folder says which are synthetic. Somebody who made neither sorts all
forty: errors near one half mean that the two cannot be told apart. OUT/frames holds the synthetic frames
whole.

The frames are what `asdfviz synth images` draws where its throws come out as the real table did: the
drape, a room's lights, the first step in bare hands, parts in the colours of the real prints. What is
set here lies within what the generator draws, or a little beyond (one lamp's size, the sky's blue).
REAL_FOLDER holds rgb/*.png of a fixed camera over a table; ASSEMBLY is what lies there; `--meshes`
names finer meshes of its parts, PART.ply in millimetres; `--grounds` photos of the empty table, as
`asdfviz synth images --grounds` takes them, instead of the drape that is drawn.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from asdfviz.data.assembly import load_assembly
from asdfviz.data.meshes import read_mesh
from asdfviz.datatypes import Part
from asdfviz.geometry.shapes import Mask, Rgb, Vector
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.description import Finish, Ground, Light, Placed, Scene
from asdfviz.synth.looks import linear, veneer
from asdfviz.synth.photo_grounds import Photos, find_photos, photographed
from asdfviz.synth.render import Picture, render
from asdfviz.synth.scene import SceneConfig, make_scene
from asdfviz.synth.sensor import RgbSensor, blur_moving, photograph
from asdfviz.synth.shading import ShadingConfig

COUNT = 20
SIDE = 128
SHOWN = 300
"""Pixels of a crop on the sheet."""
SHOTS = 3
"""Of one scene: the real frames show one, and what is seen twice would tell."""
ALIKE = 0.1
"""Shares of cloth in two crops differ by less, if any of"""
TRIES = 60
"""so many does."""
PRINTS = {
    (20, 90, 170): (20, 58, 146), (132, 132, 132): (173, 165, 154),
    (25, 25, 28): (22, 17, 16), (235, 235, 232): (226, 218, 207),
}  # fmt: skip
"""Colours of the real prints, where the mesh files say otherwise."""
BRIGHT = ((20, 60, 152), "CLAMP_BASE")
"""A print of another blue, and the end of its part's name."""
CONFIG = SceneConfig(
    width=1280, height=720, distance=(0.5, 0.58), tilt=(0.0, 0.1), true_colors=1.0, theatre=1.0,
    room_light=1.0, held=1.0, stray=0.0, hand_when_held=1.0, passing_hand=1.0, present=1.0,
    tilted=0.0, duplicates=0, distractors=0,
)  # fmt: skip
SENSOR = RgbSensor(
    exposure=0.455, blur_px=0.6, noise=0.0052, sharpening=0.7, knee=0.9, thin_px=1.6, contrast=1.08,
    saturation=1.12, jpeg_quality=94, vignette=0.08, shading=(-0.06, 0.2), glow=0.03,
)  # fmt: skip
"""What the real frames look like to have been taken with."""
LIGHT = ShadingConfig(interleave=5, shadow_pixels=1024)
"""Shadows without grain, as large pictures show them."""
CARPET_MEAN = 1.25
"""How much brighter its strands make the carpet than its first colour."""
CARPET, TABLE = (89, 60, 41), (255, 224, 176)
"""What floor and table look like beside the drape in the real frames, sRGB."""
WARM = np.array([1.03, 1.0, 0.97])
SKIN = (190, 148, 125)
SLOPE = 0.1
"""Of the folds in the real frames, down to the right, radians."""


def main(
    out: Path, real: Path, name: str, seed: int,
    meshes: Path | None, grounds: Path | None, ground_width: float,
) -> None:  # fmt: skip
    """Write the sheets, the crops, the whole frames and the key."""
    rng = np.random.default_rng(seed)
    photos = Photos() if grounds is None else find_photos(grounds, width=ground_width, share=1.0)
    taken = [_read(f) for f in sorted((real / "rgb").glob("*.png"))]
    cloth = np.median([_cloth_color(p) for p in taken], axis=0)
    assets = _matching_assets(name, meshes)
    (out / "frames").mkdir(parents=True, exist_ok=True)
    frames = _shots(assets, cloth, photos, rng)
    for k, frame in enumerate(frames):
        cv2.imwrite(str(out / f"frames/{k}.png"), frame[:, :, ::-1])
    crops = [(_crop(taken, rng), "real") for _ in range(COUNT)]
    crops += [(_crop_like(c, frames, rng), "synthetic") for c, _ in crops]
    shuffled = [crops[k] for k in rng.permutation(len(crops))]
    for k, (crop, _) in enumerate(shuffled):
        cv2.imwrite(str(out / f"{k + 1:02d}.png"), crop[:, :, ::-1])
    tiles = [_tile(crop, k + 1) for k, (crop, _) in enumerate(shuffled)]
    for page in range(2):
        rows = [tiles[i : i + 5] for i in range(20 * page, 20 * page + 20, 5)]
        cv2.imwrite(str(out / f"sheet_{page + 1}.png"), np.vstack([np.hstack(r) for r in rows]))
    key = "\n".join(f"{k + 1} {kind}" for k, (_, kind) in enumerate(shuffled))
    out.with_name(out.name + "_key.txt").write_text(key + "\n")


def _read(file: Path) -> Rgb:
    return np.ascontiguousarray(np.asarray(cv2.imread(str(file)))[:, :, ::-1])


def _tile(crop: Rgb, number: int) -> Rgb:
    """A crop enlarged, with its number in a corner (BGR)."""
    tile = cv2.resize(crop[:, :, ::-1], (SHOWN, SHOWN), interpolation=cv2.INTER_CUBIC)
    cv2.rectangle(tile, (0, 0), (44, 28), (255, 255, 255), -1)
    cv2.putText(tile, str(number), (4, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (0, 0, 0), 2)
    white = (255, 255, 255)
    return np.asarray(cv2.copyMakeBorder(tile, 3, 3, 3, 3, cv2.BORDER_CONSTANT, value=white))


def _cloth(image: Rgb) -> Mask:
    """Where the drape is seen, by its colour."""
    hue, saturation, value = np.moveaxis(cv2.cvtColor(image, cv2.COLOR_RGB2HSV), 2, 0)
    blue = (hue > 95) & (hue < 114) & (saturation > 50) & (saturation < 170)
    return blue & (value > 90)


def _cloth_color(image: Rgb) -> Vector:
    """Its median colour, sRGB."""
    return np.median(image[cv2.erode(_cloth(image).astype(np.uint8), np.ones((9, 9))) > 0], axis=0)


def _covered(image: Rgb) -> Mask:
    """The covered part of the table with all that lies on it or is held over it."""
    seen = cv2.erode(_cloth(image).astype(np.uint8), np.ones((5, 5)))
    outlines = cv2.findContours(seen, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)[0]
    filled = np.zeros_like(seen)
    cv2.fillConvexPoly(filled, cv2.convexHull(max(outlines, key=cv2.contourArea)), 1)
    covered = cv2.erode(filled, np.ones((9, 9))) > 0
    half = SIDE // 2
    covered[:half] = covered[-half:] = covered[:, :half] = covered[:, -half:] = False
    return covered


def _crop(frames: list[Rgb], rng: np.random.Generator) -> Rgb:
    """A random place over the covered table in a random frame."""
    frame, half = frames[int(rng.integers(len(frames)))], SIDE // 2
    v, u = np.nonzero(_covered(frame))
    k = int(rng.integers(len(u)))
    return frame[v[k] - half : v[k] + half, u[k] - half : u[k] + half]


def _crop_like(crop: Rgb, frames: list[Rgb], rng: np.random.Generator) -> Rgb:
    """One that shows about as much cloth, or else how full a table is would tell."""
    wanted = _cloth(crop).mean()
    others = [_crop(frames, rng) for _ in range(TRIES)]
    off = [abs(float(_cloth(other).mean() - wanted)) for other in others]
    near = [k for k, by in enumerate(off) if by < ALIKE]
    return others[near[0] if near else int(np.argmin(off))]


def _matching_assets(name: str, meshes: Path | None) -> Assets:
    """The assembly in its real colours, in the state of the real frames only."""
    assembly = load_assembly(name)
    parts = {n: _as_printed(n, p, meshes) for n, p in assembly.parts.items()}
    return load_assets(replace(assembly, parts=parts, states=assembly.states[1:2]))


def _as_printed(name: str, part: Part, meshes: Path | None) -> Part:
    """The part in the real print's colour and, if there is one, with its finer mesh."""
    color = PRINTS.get(tuple(part.color.tolist()), tuple(part.color.tolist()))
    color = BRIGHT[0] if name.endswith(BRIGHT[1]) else color
    file = None if meshes is None else meshes / f"{name}.ply"
    fine = file if file is not None and file.exists() else None
    mesh = part.mesh if fine is None else read_mesh(fine, unit="mm", part=name)
    return replace(part, color=np.array(color, np.uint8), mesh=mesh)


def _shots(assets: Assets, cloth: Vector, photos: Photos, rng: np.random.Generator) -> list[Rgb]:
    """One scene as the real camera takes it a few times, some hands in motion.

    It is exposed so that the drape has its colour.
    """
    scene = _like_the_real_one(_scene(assets, rng), assets, photos, rng)
    scene = _toned(scene, cloth)
    still = render([scene], assets.bank, rng=rng, supersampling=2.5, shading=LIGHT)[0]
    moving = [i for i, p in enumerate(scene.placed) if p.kind == "hand" and rng.random() < 0.5]
    sensor = replace(SENSOR, noise=0.002) if photos.files else SENSOR  # photos have their grain
    shots: list[Rgb] = []
    for _ in range(SHOTS):
        radiance, seed = still.radiance, int(rng.integers(2**31))
        for i in moving:
            dx, dy = rng.normal(size=2) * 4.5
            radiance = blur_moving(radiance, still.ids == i, (float(dx), float(dy)))
        shots.append(_exposed(replace(still, radiance=radiance), sensor, cloth, seed))
    return shots


def _exposed(picture: Picture, sensor: RgbSensor, cloth: Vector, seed: int) -> Rgb:
    for _ in range(7):
        color = _cloth_color(_taken(picture, sensor, seed))
        r, g, b = (cloth / np.maximum(color, 1)) ** 2.0
        tint = np.array(sensor.white_balance) * np.array([r / g, 1.0, b / g]) ** 0.7
        balance = (float(tint[0]), float(tint[1]), float(tint[2]))
        sensor = replace(sensor, exposure=sensor.exposure * float(g), white_balance=balance)
    return _taken(picture, sensor, seed)


def _taken(picture: Picture, sensor: RgbSensor, seed: int) -> Rgb:
    rgb = photograph(picture.radiance, sensor=sensor, rng=np.random.default_rng(seed))
    setting = [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality]
    encoded = cv2.imencode(".jpg", rgb[:, :, ::-1], setting)[1]
    return np.ascontiguousarray(np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR))[:, :, ::-1])


def _scene(assets: Assets, rng: np.random.Generator) -> Scene:
    """The next scene whose hands wear neither gloves nor sleeves: the real ones are bare."""
    while True:
        scene = make_scene(assets, rng=rng, config=CONFIG).scene
        hands = [p.finish for p in scene.placed if p.kind == "hand"]
        if hands and all(f.translucency > 0 for f in hands):
            return scene


def _like_the_real_one(
    scene: Scene, assets: Assets, photos: Photos, rng: np.random.Generator
) -> Scene:
    """Two panels to one side, folds along the picture, all hands of one skin."""
    right = scene.T_camera_world[0, :2]
    along = float(np.arctan2(right[1], right[0]) - SLOPE + rng.normal() * 0.03)
    drape, *others = scene.grounds
    drape = replace(drape, angle=along + np.pi / 2, bump=1.4)
    if photos.files:
        drape = _photographed(drape, photos, along, rng)
    return replace(
        scene,
        grounds=(drape, *others),
        lights=_panels(rng),
        sky=WARM * [0.9, 1.0, 1.12] * 0.42,
        placed=tuple(replace(p, finish=_finish(p, assets)) for p in scene.placed),
    )


def _photographed(drape: Ground, photos: Photos, turn: float, rng: np.random.Generator) -> Ground:
    """A photo instead of the drape, upright and as bright."""
    lying = photographed(drape, photos, rng)
    assert lying.photo is not None
    bright = float(drape.colors[0].mean() / lying.colors.mean())
    photo = replace(lying.photo, gain=lying.photo.gain * bright)
    return replace(lying, photo=photo, colors=lying.colors * bright, angle=turn, offset=(0.0, 0.0))


def _toned(scene: Scene, cloth: Vector) -> Scene:
    """Floor and table as bright as they are beside the drape."""
    drape, table, rim, carpet = scene.grounds
    blue = drape.colors[0] / linear(cloth)
    pale = linear(TABLE) * blue
    pale *= min(1.0, 0.9 / float(pale.max()))
    brown = linear(CARPET) * blue / CARPET_MEAN
    table = replace(table, colors=veneer(pale))
    carpet = replace(carpet, colors=carpet.colors * (brown / carpet.colors[0]))
    return replace(scene, grounds=(drape, table, rim, carpet))


def _panels(rng: np.random.Generator) -> tuple[Light, ...]:
    side = rng.random() * 2 * np.pi
    lights: list[Light] = []
    for share, radius, beside in ((0.55, 0.5, 0.0), (0.5, 1.0, 0.9)):
        azimuth, elevation = side + beside + rng.normal() * 0.2, rng.uniform(0.7, 1.0)
        flat = np.cos(elevation)
        where = np.array([np.cos(azimuth) * flat, np.sin(azimuth) * flat, np.sin(elevation)]) * 2.4
        lights.append(Light(where, radius, WARM * share))
    return tuple(lights)


def _finish(thing: Placed, assets: Assets) -> Finish:
    """Skin of one tone; prints in fine layers, deepest on the black ones, hardly any on the bright."""
    if thing.kind == "hand":
        return replace(thing.finish, color=linear(SKIN), translucency=0.3)
    if not thing.truth:
        return thing.finish
    black = bool(np.max(assets.assembly.parts[thing.name].color) < 60)
    bright = thing.name.endswith(BRIGHT[1])
    return replace(
        thing.finish,
        color=linear(assets.assembly.parts[thing.name].color),
        roughness=0.42 if black else 0.5,
        mottling=0.08,
        layer_height=0.0011,
        layer_depth=0.03 if black else 0.008 if bright else 0.02,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Makes a sorting test; see the top of the file.")
    for name, kind in {"out": Path, "real": Path, "name": str, "seed": int}.items():
        parser.add_argument(name, type=kind)
    parser.add_argument("--meshes", type=Path)
    parser.add_argument("--grounds", type=Path)
    parser.add_argument("--ground-width", type=float, default=0.6)
    main(**vars(parser.parse_args()))
