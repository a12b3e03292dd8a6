"""Makes a sorting test: `python tests/looks/make_sorting_test.py OUT REAL_FOLDER ASSEMBLY SEED [SHRINK] [MESHES]`.

Twenty crops of synthetic scenes among twenty of real frames, shuffled and numbered, as one sheet
(OUT/sheet.png) and as single files; OUT_key.txt beside the folder says which are synthetic. Somebody
who made neither sorts all forty: errors near one half mean that the two cannot be told apart.

REAL_FOLDER holds rgb/*.png of a fixed camera over a table; ASSEMBLY is what lies there. SHRINK is how
many pixels of the camera make one of the crop: 1 (what the camera sees) or 2 (what the detector is given
of 1280x720). MESHES holds finer meshes of its parts, PART.ply in millimetres, where there are any.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from asdfviz.data.assembly import load_assembly
from asdfviz.data.meshes import read_mesh
from asdfviz.datatypes import Part
from asdfviz.geometry.transforms import rotation_about
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.description import Light, Placed, Scene
from asdfviz.synth.looks import linear
from asdfviz.synth.render import Picture, render
from asdfviz.synth.scene import SceneConfig, make_scene
from asdfviz.synth.sensor import RgbSensor, blur_moving, metered, photograph

COUNT = 20
SIDE = 160
SHOWN = 240
"""Pixels of a crop on the sheet."""
REAL_PLACES = (
    (410, 385), (430, 560), (615, 530), (770, 555), (930, 540), (920, 375), (950, 235), (600, 175),
    (650, 260), (740, 350), (730, 430), (800, 210), (560, 90), (880, 110), (1120, 320), (330, 230),
    (560, 640), (230, 420), (1000, 640), (880, 480), (300, 90), (480, 480),
)  # fmt: skip
"""Parts, hands, cloth and rims in the real frames, pixels."""
COLORS = {
    (20, 90, 170): (33, 67, 162),
    (132, 132, 132): (190, 172, 157),
    (25, 25, 28): (29, 23, 21),
    (235, 235, 232): (230, 216, 198),
}
"""Colours of the real prints, where the mesh files say otherwise."""
SENSOR = RgbSensor(
    vignette=0.13, blur_px=0.48, softness_px=1.15, noise=0.0076, flare=0.014, contrast=1.12,
    sharpening=0.22, knee=0.5, thin_px=1.6, fringe_px=1.2, jpeg_quality=90,
)  # fmt: skip
"""What the real frames look like to have been taken with."""


CLOTH = np.array([0.250, 0.383, 0.492])
"""Linear colour that the real camera's exposure and white balance give to the cloth."""


def main(out: Path, real: Path, name: str, seed: int, shrink: int, meshes: Path | None) -> None:
    """Write the sheet, the crops and the key."""
    rng = np.random.default_rng(seed)
    crops = [(c, "real") for c in _real_crops(real, rng)]
    crops += [(c, "synthetic") for c in _synthetic_crops(_matching_assets(name, meshes), rng)]
    order = rng.permutation(len(crops))
    out.mkdir(parents=True, exist_ok=True)
    tiles: list[np.ndarray] = []
    for place, k in enumerate(order):
        crop = cv2.resize(
            crops[k][0], None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA
        )
        cv2.imwrite(str(out / f"{place + 1:02d}.png"), crop)
        tile = cv2.resize(crop, (SHOWN, SHOWN), interpolation=cv2.INTER_CUBIC)
        tile = cv2.copyMakeBorder(tile, 26, 4, 2, 2, cv2.BORDER_CONSTANT, value=(255, 255, 255))
        cv2.putText(tile, str(place + 1), (6, 20), cv2.FONT_HERSHEY_SIMPLEX, 0.65, (0, 0, 0), 2)
        tiles.append(tile)
    rows = [np.hstack(tiles[i : i + 8]) for i in range(0, len(tiles), 8)]
    cv2.imwrite(str(out / "sheet.png"), np.vstack(rows))
    key = "\n".join(f"{place + 1} {crops[k][1]}" for place, k in enumerate(order))
    out.with_name(out.name + "_key.txt").write_text(key + "\n")


def _cut(image: np.ndarray, u: float, v: float) -> np.ndarray:
    height, width = image.shape[:2]
    x = int(np.clip(u - SIDE / 2, 0, width - SIDE))
    y = int(np.clip(v - SIDE / 2, 0, height - SIDE))
    return image[y : y + SIDE, x : x + SIDE]


def _real_crops(folder: Path, rng: np.random.Generator) -> list[np.ndarray]:
    files = sorted((folder / "rgb").glob("*.png"))
    frames = [np.asarray(cv2.imread(str(f))) for f in files]
    chosen = rng.permutation(len(REAL_PLACES))[:COUNT]
    crops: list[np.ndarray] = []
    for k in chosen:
        u, v = REAL_PLACES[k] + rng.uniform(-35, 35, 2)
        crops.append(_turned(_cut(frames[int(rng.integers(len(frames)))], u, v), rng))
    return crops


def _turned(crop: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Any of four sides up, so that the known direction of the real light gives nothing away."""
    return np.ascontiguousarray(np.rot90(crop, int(rng.integers(4))))


def _matching_assets(name: str, meshes: Path | None) -> Assets:
    """The assembly in its real colours, in its first states only."""
    assembly = load_assembly(name)
    parts = {n: _as_printed(n, p, meshes) for n, p in assembly.parts.items()}
    return load_assets(replace(assembly, parts=parts, states=assembly.states[:2]))


def _as_printed(name: str, part: Part, meshes: Path | None) -> Part:
    """The part in the real print's colour and, if there is one, with its finer mesh."""
    color = np.array(COLORS.get(tuple(part.color.tolist()), part.color), np.uint8)
    file = None if meshes is None else meshes / f"{name}.ply"
    fine = file if file is not None and file.exists() else None
    mesh = part.mesh if fine is None else read_mesh(fine, unit="mm", part=name)
    return replace(part, color=color, mesh=mesh)


def _synthetic_crops(assets: Assets, rng: np.random.Generator) -> list[np.ndarray]:
    config = SceneConfig(
        width=1280, height=720, distance=(0.5, 0.56), tilt=(0.0, 0.05), true_colors=1.0,
        theatre=1.0, room_light=1.0, present=1.0, distractors=0, duplicates=0, tilted=0.0, held=0.6,
        passing_hand=0.5,
    )  # fmt: skip
    crops: list[np.ndarray] = []
    while len(crops) < COUNT:
        image, scene, picture = _photo(assets, config, rng)
        for u, v in _places(scene, picture, rng)[: COUNT - len(crops)]:
            crops.append(_turned(_cut(image, u, v), rng))
    return crops


def _photo(
    assets: Assets, config: SceneConfig, rng: np.random.Generator
) -> tuple[np.ndarray, Scene, Picture]:
    """One scene as the real camera takes it (BGR), hands sometimes in motion."""
    scene = make_scene(assets, rng=rng, config=config).scene
    scene = replace(
        scene, placed=tuple(_real(assets, p, rng) for p in scene.placed if not _foreign(p))
    )
    scene = _squared(scene, rng)
    scene = replace(scene, lights=_across_folds(scene, rng), sky=scene.sky * 1.35)
    picture = render([scene], assets.bank, rng=rng, supersampling=3.0)[0]
    radiance = picture.radiance
    for i, thing in enumerate(scene.placed):
        if thing.kind == "hand" and rng.random() < 0.5:
            dx, dy = rng.normal(size=2) * 4.5
            radiance = blur_moving(radiance, picture.ids == i, (float(dx), float(dy)))
    radiance = _balanced(radiance, picture, rng)
    sensor = replace(SENSOR, exposure=metered(radiance))
    rgb = photograph(radiance, sensor=sensor, rng=rng)
    setting = [cv2.IMWRITE_JPEG_QUALITY, sensor.jpeg_quality]
    encoded = cv2.imencode(".jpg", rgb[:, :, ::-1], setting)[1]
    return np.asarray(cv2.imdecode(encoded, cv2.IMREAD_COLOR)), scene, picture


def _squared(scene: Scene, rng: np.random.Generator) -> Scene:
    """The cloth laid as the real one is: its folds along the sides of the picture."""
    x, y = scene.T_camera_world[0, :2]
    turn = np.arctan2(y, x) + rng.normal() * 0.05 + np.pi / 2 * rng.integers(4)
    cloth, *others = scene.grounds
    return replace(scene, grounds=(replace(cloth, angle=float(turn)), *others))


def _across_folds(scene: Scene, rng: np.random.Generator) -> tuple[Light, ...]:
    """The lights turned about the table so that the first shines across the cloth's folds."""
    x, y, _ = scene.lights[0].position
    turn = scene.grounds[0].angle + rng.normal() * 0.5 - np.arctan2(y, x)
    R = rotation_about(np.array([0.0, 0.0, 1.0]), float(turn))
    return tuple(replace(light, position=R @ light.position) for light in scene.lights)


def _on_table(picture: Picture) -> np.ndarray:
    return (picture.ids < 0) & (picture.depth > 0) & (picture.depth < 1.0)


def _balanced(radiance: np.ndarray, picture: Picture, rng: np.random.Generator) -> np.ndarray:
    """The light scaled so that the cloth comes out as bright and as blue as the real camera has it."""
    cloth = np.median(radiance[_on_table(picture) & (picture.albedo < 0.5)], axis=0)
    return (radiance * (CLOTH * np.exp(rng.normal(size=3) * 0.012) / cloth)).astype(np.float32)


def _foreign(thing: Placed) -> bool:
    """A sleeve or a stand: the real frames show none."""
    return thing.kind == "distractor" or (thing.kind == "hand" and thing.finish.roughness > 0.9)


def _real(assets: Assets, thing: Placed, rng: np.random.Generator) -> Placed:
    """The same hand and the same filaments for all."""
    if thing.kind == "hand":
        tone = linear((192, 148, 123)) * np.exp(rng.normal() * 0.06)
        finish = replace(thing.finish, color=tone, translucency=0.35, roughness=0.5)
    else:
        color = linear(assets.assembly.parts[thing.name].color) * np.exp(rng.normal() * 0.06)
        dark = bool(color.max() < 0.1)
        finish = replace(
            thing.finish,
            color=np.clip(color, 0.003, 0.95),
            roughness=float(rng.uniform(0.42, 0.6)),
            mottling=float(rng.uniform(0.05, 0.25)),
            layer_axis=int(rng.integers(3)) if dark and rng.random() < 0.5 else _level_axis(thing),
            layer_height=float(rng.uniform(0.0006, 0.0018)),
            layer_depth=float(rng.uniform(0.07, 0.16)),
        )
    return replace(thing, finish=finish)


def _level_axis(thing: Placed) -> int:
    """The mesh's axis that stands upright."""
    return int(np.abs(thing.T_world_mesh[2, :3]).argmax())


def _places(scene: Scene, picture: Picture, rng: np.random.Generator) -> list[np.ndarray]:
    """Up to five places in one picture: three things, a hand if there is one, cloth or a rim."""
    things = [i for i, p in enumerate(scene.placed) if p.kind == "part"]
    hands = [i for i, p in enumerate(scene.placed) if p.kind == "hand"]
    wanted = [int(i) for i in rng.permutation(things)[:3]]
    wanted += [int(i) for i in rng.permutation(hands)[:1]]
    places: list[np.ndarray] = []
    for i in wanted:
        v, u = np.nonzero(picture.ids == i)
        if len(u) > 200:
            k = int(rng.integers(len(u)))
            middle = np.array([u.mean(), v.mean()])
            spot = middle + 0.5 * (np.array([u[k], v[k]]) - middle)
            places.append(spot + rng.uniform(-35, 35, 2))
    v, u = np.nonzero(_on_table(picture))
    k = int(rng.integers(len(u)))
    return [*places, np.array([u[k], v[k]], np.float64)]


if __name__ == "__main__":
    main(
        Path(sys.argv[1]),
        Path(sys.argv[2]),
        sys.argv[3],
        int(sys.argv[4]),
        int(sys.argv[5]) if len(sys.argv) > 5 else 1,
        Path(sys.argv[6]) if len(sys.argv) > 6 else None,
    )
