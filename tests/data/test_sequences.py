from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from asdfviz.data.assembly_writer import write_assembly
from asdfviz.data.hashes import sequence_sha256
from asdfviz.data.images import read_raw_depth, read_rgb
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Assembly
from asdfviz.errors import SequenceError

WriteScene = Callable[..., Any]


@pytest.mark.parametrize(
    ("kind", "suffix", "scale"),
    [
        ("folder", ".png", 1.0),
        ("bop", ".png", 0.5),
        ("gbot", ".png", 0.5),
        ("folder", ".jpg", 1.0),
        ("gbot", ".jpeg", 0.5),
    ],
)
def test_a_scene_is_recognised_and_read_as_it_was_written(
    write_scene: WriteScene, kind: str, suffix: str, scale: float
) -> None:
    scene = write_scene(kind, suffix=suffix)
    sequence = open_sequence(scene.folder)
    assert (sequence.format, sequence.name, len(sequence)) == (kind, "scene", 3)
    assert sequence.frame_indices == (3, 4, 7)
    assert sequence.path == str(scene.folder.resolve())
    for place, index in enumerate((3, 4, 7)):
        frame = sequence[place]
        assert frame.index == index
        assert frame.time == pytest.approx(index / 30.0)
        close = 0 if suffix == ".png" else 12
        assert np.abs(frame.rgb.astype(int) - scene.rgb[index]).max() <= close or suffix != ".png"
        assert np.median(np.abs(frame.rgb.astype(int) - scene.rgb[index])) <= close
        assert frame.depth is not None
        np.testing.assert_allclose(frame.depth, scene.raw_depth[index] * scale * 1e-3, atol=1e-7)
        assert frame.camera.K[0].tolist() == [90.0, 0.0, 47.0]
        assert frame.camera.K[1].tolist() == [0.0, 91.0, 31.0]
        assert (frame.camera.width, frame.camera.height) == (96, 64)
        assert frame.camera.distortion is None
        with pytest.raises(ValueError, match="read-only"):
            frame.rgb[0, 0, 0] = 1
    assert sequence[-1].index == 7
    with pytest.raises(IndexError):
        sequence[3]


def test_frames_join_by_number_and_depth_may_be_missing(write_scene: WriteScene) -> None:
    scene = write_scene("folder")
    (scene.folder / "depth" / "000004.png").unlink()
    (scene.folder / "depth" / "000003.png").rename(scene.folder / "depth" / "3.png")
    sequence = open_sequence(scene.folder)
    depths = [sequence[i].depth for i in range(3)]
    assert depths[0] is not None
    assert depths[1] is None
    assert depths[2] is not None
    shutil.rmtree(scene.folder / "depth")
    assert open_sequence(scene.folder)[0].depth is None


def test_depth_scale_is_one_where_no_file_says(write_scene: WriteScene) -> None:
    scene = write_scene("gbot")
    cameras = scene.read("scene_camera.json")
    for entry in cameras.values():
        del entry["depth_scale"]
    scene.write("scene_camera.json", cameras)
    depth = open_sequence(scene.folder)[0].depth
    assert depth is not None
    assert depth[-1, -1] == pytest.approx(0.503)


def test_each_frame_has_its_own_camera(write_scene: WriteScene) -> None:
    scene = write_scene("gbot")
    cameras = scene.read("scene_camera.json")
    cameras["7"]["cam_K"][0] = 120.0
    scene.write("scene_camera.json", cameras)
    sequence = open_sequence(scene.folder)
    assert [sequence[i].camera.K[0, 0] for i in range(3)] == [90.0, 90.0, 120.0]
    assert sequence.camera.K[0, 0] == 90.0


@pytest.mark.parametrize("length", [4, 5, 8])
def test_colour_is_undistorted_and_depth_is_not(write_scene: WriteScene, length: int) -> None:
    scene = write_scene("folder")
    distortion = [0.2, -0.1, 0.002, -0.001, 0.05, 0.03, -0.02, 0.01][:length]
    camera = scene.read("camera.json")
    plain = open_sequence(scene.folder)[0]
    scene.write("camera.json", {**camera, "distortion": distortion})
    frame = open_sequence(scene.folder)[0]
    expected = cv2.undistort(plain.rgb, plain.camera.K, np.array(distortion))
    assert np.abs(frame.rgb.astype(int) - expected).max() <= 1
    assert np.abs(frame.rgb.astype(int) - plain.rgb).max() > 10
    assert frame.depth is not None
    assert plain.depth is not None
    np.testing.assert_array_equal(frame.depth, plain.depth)
    assert frame.camera.distortion is None
    np.testing.assert_array_equal(frame.camera.K, plain.camera.K)


def test_sequence_json_gives_rate_and_assembly(
    write_scene: WriteScene, tiny: Assembly, tmp_path: Path
) -> None:
    scene = write_scene("gbot")
    write_assembly(tiny, tmp_path / "models" / "tiny")
    scene.write("sequence.json", {"fps": 10, "assembly": "../models/tiny"})
    sequence = open_sequence(scene.folder)
    assert sequence[0].time == pytest.approx(0.3)
    assert sequence.assembly is not None
    assert sequence.assembly.name == "tiny"
    truth = sequence.truth(1)
    assert truth is not None
    assert set(truth.T_camera_part) == {"base", "jaw"}
    scene.write("sequence.json", {"assembly": "gone"})
    sequence = open_sequence(scene.folder)
    assert (sequence.assembly, sequence.missing_assembly) == (None, "gone")
    assert sequence.truth(0) is None
    assert open_sequence(scene.folder, assembly=tiny).assembly is tiny


def test_format_overrides_where_it_can(write_scene: WriteScene) -> None:
    scene = write_scene("gbot")
    scene.write("camera.json", {"fx": 80, "fy": 80, "cx": 48, "cy": 32})
    assert open_sequence(scene.folder).camera.K[0, 0] == 90.0
    as_folder = open_sequence(scene.folder, format="folder")
    assert (as_folder.format, as_folder.camera.K[0, 0]) == ("folder", 80.0)
    (scene.folder / "scene_gt.json").unlink()
    assert open_sequence(scene.folder).format == "bop"
    assert open_sequence(scene.folder, format="gbot").format == "gbot"


def test_the_bundled_sample_opens_by_its_word(
    write_scene: WriteScene, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = write_scene("folder", name="clip")
    monkeypatch.setattr("asdfviz.data.sequences.sample_folder", lambda: scene.folder)
    assert open_sequence("sample").name == "sample"


def drop(name: str) -> Callable[[Path], object]:
    return lambda folder: (
        shutil.rmtree(folder / name) if "." not in name else (folder / name).unlink()
    )


def put(name: str, content: object) -> Callable[[Path], object]:
    text = content if isinstance(content, str) else json.dumps(content)
    return lambda folder: (folder / name).write_text(text, encoding="utf-8")


def as_file(name: str) -> Callable[[Path], object]:
    def damage(folder: Path) -> None:
        shutil.rmtree(folder / name)
        (folder / name).write_text("not a folder")

    return damage


def no_frames(folder: Path) -> None:
    for image in (folder / "rgb").iterdir():
        image.rename(image.with_name(f"view_{image.name}"))


def bitmaps(folder: Path) -> None:
    for image in (folder / "rgb").iterdir():
        image.rename(image.with_suffix(".bmp"))


def in_color(folder: Path) -> None:
    (folder / "rgb").rename(folder / "color")


def depth_as(change: Callable[[Path], Path]) -> Callable[[Path], None]:
    """Gives every depth image another name."""

    def damage(folder: Path) -> None:
        for image in sorted((folder / "depth").iterdir()):
            image.rename(change(image))
        (folder / "depth" / "times.txt").write_text("0")

    return damage


def twin(folder: Path) -> None:
    shutil.copy(folder / "rgb" / "000003.png", folder / "rgb" / "3.jpg")


GOOD_K = [9, 0, 1, 0, 9, 1, 0, 0, 1]
CAMERA = {"fx": 90.0, "fy": 91.0, "cx": 47.0, "cy": 31.0, "width": 96, "height": 64}


@pytest.mark.parametrize(
    ("kind", "damage", "message"),
    [
        ("folder", drop("rgb"), r"no folder rgb/"),
        ("folder", as_file("depth"), r"depth is a file; it must be a folder"),
        (
            "folder",
            no_frames,
            r"holds no frames, but 3 images whose names are no numbers, as view_000003\.png; name them 000000\.png",
        ),
        (
            "folder",
            bitmaps,
            r"but 3 bmp files, of a kind that is not read; save them as 000000\.png",
        ),
        ("folder", in_color, r"no folder rgb/; a scene holds .*; is it color/\? Call it rgb$"),
        (
            "folder",
            depth_as(lambda image: image.with_suffix(".exr")),
            r"depth holds no depth that can be used, but 3 exr files, .*; save it as 16-bit PNG .* or take",
        ),
        (
            "folder",
            depth_as(lambda image: image.with_name(f"depth_{image.name}")),
            r"but 3 images whose names are no numbers, as depth_000003\.png",
        ),
        (
            "folder",
            depth_as(lambda image: image.with_name(f"1{image.name[1:]}")),
            r"none of 3 depth images has the number of a colour image \(depth 100003, .*colour 3, 4",
        ),
        ("folder", twin, r"000003\.png and 3\.jpg are both frame 3"),
        ("folder", drop("camera.json"), r"no camera file; add camera\.json"),
        ("folder", put("camera.json", "{"), r"camera\.json is not valid JSON.*line 1"),
        ("folder", put("camera.json", []), r"expected an object"),
        ("folder", put("camera.json", {"fx": 1}), r"'fy' is missing"),
        ("folder", put("camera.json", {**CAMERA, "fx": float("nan")}), r"'fx': .*finite"),
        ("folder", put("camera.json", {**CAMERA, "fx": "90"}), r"'fx': expected a number"),
        ("folder", put("camera.json", {**CAMERA, "fx": None}), r"'fx' is missing \(it is null\)"),
        ("folder", put("camera.json", {**CAMERA, "fy": -3}), r"focal lengths must be positive"),
        ("folder", put("camera.json", {**CAMERA, "width": 0}), r"must be positive pixels"),
        ("folder", put("camera.json", {**CAMERA, "depth_scale": 0}), r"millimetres per unit"),
        (
            "folder",
            put("camera.json", {**CAMERA, "depth_scale": 1e300}),
            r"above 0 and up to 1e\+06",
        ),
        (
            "folder",
            put("camera.json", {**CAMERA, "distortion": [1, 2]}),
            r"4 or 5 or 8 finite numbers",
        ),
        ("folder", put("sequence.json", {"fps": -1}), r"frames per second"),
        ("folder", put("sequence.json", {"assembly": 3}), r"'assembly': expected text"),
        ("gbot", drop("scene_camera.json"), r"no camera\.json and no scene_camera\.json"),
        ("gbot", put("scene_camera.json", {}), r"is empty"),
        ("gbot", put("scene_camera.json", {"3": {"cam_K": [1] * 8}}), r"9 finite numbers"),
        ("gbot", put("scene_camera.json", {"3": {"cam_K": [1] * 9}}), r"not a camera matrix"),
        (
            "gbot",
            put("scene_camera.json", {"x": {"cam_K": [1] * 9}}),
            r"frame number|camera matrix",
        ),
        (
            "gbot",
            put("scene_camera.json", {"3": {"cam_K": GOOD_K}}),
            r"no entry '4'",
        ),
        ("gbot", put("scene_gt.json", "nonsense"), r"scene_gt\.json is not valid JSON"),
        (
            "gbot",
            put("scene_gt.json", {"3": [{"obj_id": 1}, {"obj_id": "base"}]}),
            r"mixes obj_ids",
        ),
        ("gbot", put("scene_gt.json", {"3": [{"obj_id": 1.5}]}), r"whole number \(BOP\)"),
    ],
)
def test_a_broken_scene_is_refused_on_opening(
    write_scene: WriteScene, kind: str, damage: Callable[[Path], object], message: str
) -> None:
    scene = write_scene(kind)
    damage(scene.folder)
    with pytest.raises(SequenceError, match=message):
        open_sequence(scene.folder)


@pytest.mark.parametrize(
    ("path", "format", "message"),
    [
        ("nowhere", None, r"no scene folder at"),
        (".", None, r"scenes lie in it; open one of them: scene"),
        ("scene", "kitti", r"unknown format 'kitti'; formats: folder, bop, gbot"),
        ("scene", "bop", r"obj_ids of scene_gt\.json are names; use 'gbot'"),
        ("scene", "folder", r"has no camera\.json; add it"),
    ],
)
def test_what_cannot_be_opened_says_what_would_be_right(
    write_scene: WriteScene, tmp_path: Path, path: str, format: str | None, message: str
) -> None:
    write_scene("gbot")
    with pytest.raises(SequenceError, match=message):
        open_sequence(tmp_path / path, format=format)


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-30])


def image(array: np.ndarray) -> Callable[[Path], object]:
    return lambda path: cv2.imwrite(str(path), array)


@pytest.mark.parametrize(
    ("file", "damage", "message"),
    [
        ("rgb/000003.png", Path.unlink, r"000003\.png does not exist"),
        ("rgb/000003.png", truncate, r"truncated"),
        ("rgb/000003.png", lambda path: path.write_bytes(b""), r"truncated .*0 bytes"),
        ("rgb/000003.png", lambda path: path.write_text("hello"), r"no PNG or JPEG"),
        ("rgb/000003.png", image(np.zeros((32, 48, 3), np.uint8)), r"is 48 x 32 pixels.*96 x 64"),
        ("depth/000003.png", truncate, r"truncated"),
        ("depth/000003.png", image(np.zeros((64, 96), np.uint8)), r"8 bit with 1 channel"),
        ("depth/000003.png", image(np.zeros((64, 96, 3), np.uint16)), r"16 bit with 3 channel"),
        ("depth/000003.png", image(np.zeros((32, 48), np.uint16)), r"is 48 x 32 pixels"),
    ],
)
def test_a_broken_image_is_refused_when_it_is_read(
    write_scene: WriteScene, file: str, damage: Callable[[Path], object], message: str
) -> None:
    scene = write_scene("folder")
    sequence = open_sequence(scene.folder)
    damage(scene.folder / file)
    with pytest.raises(SequenceError, match=message):
        sequence[0]
    assert sequence[1].index == 4


def test_a_folder_for_depth_may_be_empty_but_for_notes(write_scene: WriteScene) -> None:
    scene = write_scene("folder")
    for image in (scene.folder / "depth").iterdir():
        image.unlink()
    (scene.folder / "depth" / "times.txt").write_text("0")
    (scene.folder / "depth" / ".hidden.exr").write_text("")
    assert open_sequence(scene.folder)[0].depth is None


def write_npy(path: Path, array: np.ndarray) -> None:
    np.save(path, array)


def write_tiff(path: Path, array: np.ndarray) -> None:
    assert cv2.imwrite(str(path), array)


WRITERS = [(".npy", write_npy), (".tiff", write_tiff), (".tif", write_tiff)]


@pytest.mark.parametrize(("suffix", "write"), WRITERS)
def test_depth_of_16_bit_is_read_from_tiff_and_npy(
    write_scene: WriteScene, suffix: str, write: Callable[[Path, np.ndarray], None]
) -> None:
    scene = write_scene("gbot")
    hashed = sequence_sha256(scene.folder)
    for index, raw in scene.raw_depth.items():
        file = scene.folder / "depth" / f"{index:06d}{suffix}"
        write(file, raw)
        # Beside a PNG it counts as a copy.
        assert sequence_sha256(scene.folder) == hashed
        file.with_suffix(".png").unlink()
        hashed = sequence_sha256(scene.folder)
    sequence = open_sequence(scene.folder)
    assert list(sequence.files.depth) == list(scene.raw_depth)
    for place, raw in enumerate(scene.raw_depth.values()):
        depth = sequence[place].depth
        assert depth is not None
        np.testing.assert_allclose(depth, raw * np.float32(0.5e-3))
    file = next(iter(sequence.files.depth.values()))
    write(file, np.full((64, 96), 7, np.uint16))
    assert sequence_sha256(scene.folder) != hashed
    # Whatever it is called, its bytes tell what it is.
    file.rename(file.with_suffix(".png"))
    assert open_sequence(scene.folder)[0].depth is not None


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (
            np.zeros((64, 96), np.float32),
            r"32 bit float with 1 channel; .* save np\.nan_to_num\(1000",
        ),
        (np.zeros((64, 96), np.int32), r"32 bit with 1 channel; .* save it as np\.uint16"),
        (np.zeros(64, np.uint16), r"an array of shape \(64,\); .* 16 bit with one channel"),
        (np.zeros((32, 48), ">u2"), r"is 48 x 32 pixels, but the camera is 96 x 64"),
        (np.zeros((64, 96), object), r"is corrupt"),
    ],
)
def test_an_array_that_is_no_depth_is_refused(
    write_scene: WriteScene, array: np.ndarray, message: str
) -> None:
    scene = write_scene("folder")
    for file in (scene.folder / "depth").iterdir():
        np.save(file.with_suffix(".npy"), array)
        file.unlink()
    with pytest.raises(SequenceError, match=message):
        open_sequence(scene.folder)[0]


@pytest.mark.parametrize(("suffix", "write"), WRITERS)
def test_a_cut_tiff_or_npy_is_refused(
    write_scene: WriteScene, suffix: str, write: Callable[[Path, np.ndarray], None]
) -> None:
    scene = write_scene("folder")
    for index, raw in scene.raw_depth.items():
        file = scene.folder / "depth" / f"{index:06d}{suffix}"
        write(file, raw)
        truncate(file)
        file.with_suffix(".png").unlink()
    with pytest.raises(SequenceError, match="is corrupt"):
        open_sequence(scene.folder)[0]


def exif_with(tag: int) -> Image.Exif:
    exif = Image.Exif()
    exif[0x0112] = tag
    return exif


@pytest.mark.parametrize("tag", [2, 3, 6])
@pytest.mark.parametrize("order", ["II", "MM", "big"])
def test_depth_that_asks_to_be_turned_is_refused(
    write_scene: WriteScene, tag: int, order: str
) -> None:
    scene = write_scene("folder")
    for index, raw in scene.raw_depth.items():
        file = scene.folder / "depth" / f"{index:06d}.tiff"
        image = Image.fromarray(raw.astype(">u2") if order == "MM" else raw)
        image.save(file, tiffinfo={274: tag}, big_tiff=order == "big")
        assert file.read_bytes().startswith({"II": b"II*", "MM": b"MM", "big": b"II+"}[order])
        file.with_suffix(".png").unlink()
    with pytest.raises(SequenceError, match=rf"orientation tag \({tag}\) .* save it without"):
        open_sequence(scene.folder)[0]
    for index, raw in scene.raw_depth.items():
        Image.fromarray(raw).save(
            scene.folder / "depth" / f"{index:06d}.tiff", tiffinfo={274: 1}, big_tiff=order == "big"
        )
    sequence = open_sequence(scene.folder)
    for place, raw in enumerate(scene.raw_depth.values()):
        depth = sequence[place].depth
        assert depth is not None
        np.testing.assert_allclose(depth, raw * np.float32(1e-3))


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("tag", [3, 6])
def test_colour_and_depth_are_read_as_stored_whatever_their_tags_ask(
    tmp_path: Path, suffix: str, tag: int
) -> None:
    bright = np.zeros((16, 32, 3), np.uint8)
    bright[:8, :16] = 200
    Image.fromarray(bright).save(tmp_path / f"rgb{suffix}", exif=exif_with(tag))
    assert np.array_equal(read_rgb(tmp_path / f"rgb{suffix}") > 100, bright > 100)
    raw = bright[..., 0].astype(np.uint16)
    Image.fromarray(raw).save(tmp_path / "depth.png", exif=exif_with(tag))
    np.testing.assert_array_equal(read_raw_depth(tmp_path / "depth.png"), raw)


def test_a_truncated_jpeg_is_refused(write_scene: WriteScene) -> None:
    scene = write_scene("folder", suffix=".jpg")
    truncate(scene.folder / "rgb" / "000003.jpg")
    with pytest.raises(SequenceError, match="truncated"):
        open_sequence(scene.folder)[0]


def test_the_real_frames_open(shared: Path) -> None:
    sequence = open_sequence(shared / "data" / "real")
    assert (sequence.format, sequence.frame_indices) == ("folder", (150, 151, 152))
    frame = sequence[0]
    assert frame.depth is not None
    assert (frame.rgb.shape, frame.depth.shape) == ((720, 1280, 3), (720, 1280))
    assert float(np.mean(frame.depth == 0)) == pytest.approx(0.431, abs=0.005)
    assert np.median(frame.depth[frame.depth > 0]) == pytest.approx(0.53, abs=0.02)
