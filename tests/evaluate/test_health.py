"""Clean scenes must pass, and each fault put into one must be named with its figure."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from memory_sequence import MemorySequence
from PIL import Image

from asdfviz.data.images import read_stored
from asdfviz.data.prefetch import Prefetcher
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Assembly, Camera, Frame, FrameTruth, Mesh, Part, State
from asdfviz.evaluate.health import Finding, HealthReport, check_sequence
from asdfviz.evaluate.health_edges import Edges, color_edges, depth_edges
from asdfviz.evaluate.health_files import check_numbering
from asdfviz.evaluate.health_shift import SCALES, measure_shift, spread
from asdfviz.geometry.camera import project
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import apply, rotation_about, transform_from

WIDTH, HEIGHT = 640, 480
K = np.array([[600.0, 0, 318.0], [0, 600.0, 243.0], [0, 0, 1]])
CAMERA = Camera(K, WIDTH, HEIGHT)
TABLE = 0.8
SIZES = {"plate": (0.16, 0.1, 0.05), "block": (0.06, 0.06, 0.08), "bar": (0.12, 0.03, 0.03)}


def box(x: float, y: float, z: float) -> Mesh:
    corners = [(i, j, k) for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [face for a, b, c, d in sides for face in ((a, c, b), (a, d, c))]
    vertices = (np.array(corners, dtype=np.float64) - 0.5) * [x, y, z]
    return Mesh(vertices, np.array(faces, dtype=np.int32))


def make_assembly(scales: dict[str, float] | None = None) -> Assembly:
    def part(name: str, obj_id: int) -> Part:
        mesh = box(*(np.array(SIZES[name]) * (scales or {}).get(name, 1.0)))
        return Part(
            name=name,
            mesh=mesh,
            keypoints=np.resize(mesh.vertices, (17, 3)),
            symmetries=Symmetries(),
            diameter=diameter(mesh.vertices),
            color=np.array([9, 9, 9], dtype=np.uint8),
            detector_class=name,
            obj_id=obj_id,
        )

    parts = {name: part(name, i) for i, name in enumerate(SIZES)}
    state = State(0, "bare", {"plate": np.eye(4)})
    return Assembly(
        "boxes", "Boxes", "plate", parts, (state,), frozenset(), tuple(SIZES), "/x.yaml"
    )


@cache
def scene(seed: int, *, shift: tuple[int, int] = (0, 0)) -> tuple[Frame, FrameTruth]:
    """Boxes with their tops towards the camera on a patterned table; depth may be moved."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(70, 190, (HEIGHT // 16, WIDTH // 16, 3)).astype(np.uint8)
    rgb = cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC).astype(np.float64)
    depth = np.full((HEIGHT, WIDTH), TABLE)
    poses: dict[str, np.ndarray] = {}
    for k, (name, size) in enumerate(SIZES.items()):
        place = [-0.2 + 0.2 * k, rng.uniform(-0.12, 0.12), TABLE - size[2] / 2]
        T = transform_from(
            rotation_about(np.array([0, 0, 1.0]), rng.uniform(0, 3)), np.array(place)
        )
        poses[name] = T
        # The table hides the sides: seen from above, a box ends where its near top edge does.
        x, y = size[0] / 2, size[1] / 2
        top = np.array([(-x, -y), (x, -y), (x, y), (-x, y)])
        corners = np.column_stack([top, np.full(4, -size[2] / 2)])
        outline = np.rint(project(apply(T, corners), K)).astype(np.int32)
        mask = np.zeros((HEIGHT, WIDTH), np.uint8)
        cv2.fillPoly(mask, [outline], 1)
        rgb[mask > 0] = rng.integers(0, 256, 3)
        depth[mask > 0] = TABLE - size[2]
    rgb += rng.normal(0, 4, rgb.shape)
    depth += rng.normal(0, 0.001, depth.shape)
    depth = np.roll(depth, (shift[1], shift[0]), axis=(0, 1))
    depth[rng.random(depth.shape) < 0.01] = 0
    frame = Frame(
        seed, seed / 30, rgb.clip(0, 255).astype(np.uint8), depth.astype(np.float32), CAMERA
    )
    return frame, FrameTruth(seed, poses, 0)


@pytest.fixture(scope="module", autouse=True)
def edges_found_once() -> Iterator[None]:
    """Most tests look at the same few images; what is found in each of them is kept."""
    kept: dict[bytes, Edges] = {}

    def once(find: Callable[[np.ndarray], Edges]) -> Callable[[np.ndarray], Edges]:
        def found_in(image: np.ndarray) -> Edges:
            key = hashlib.sha256(f"{find} {image.dtype} {image.shape}".encode())
            key.update(image.tobytes())
            if key.digest() not in kept:
                kept[key.digest()] = find(image)
            return kept[key.digest()]

        return found_in

    with pytest.MonkeyPatch.context() as patch:
        for find in (color_edges, depth_edges):
            patch.setattr(f"asdfviz.evaluate.health_shift.{find.__name__}", once(find))
        yield


Make = Callable[..., MemorySequence]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    def build(
        change: Callable[[Frame], Frame] = lambda frame: frame,
        *,
        shift: tuple[int, int] = (0, 0),
        with_truth: bool = False,
        assembly: Assembly | None = None,
        count: int = 3,
    ) -> MemorySequence:
        scenes = [scene(seed, shift=shift) for seed in range(count)]
        return MemorySequence(
            frames=tuple(change(frame) for frame, _ in scenes),
            truths=tuple(truth if with_truth else None for _, truth in scenes),
            assembly=assembly or (make_assembly() if with_truth else None),
            path=str(tmp_path),
        )

    return build


def found(report: HealthReport, kind: str) -> list[Finding]:
    return [finding for finding in report.findings if finding.kind == kind]


def only(report: HealthReport, kind: str) -> Finding:
    findings = found(report, kind)
    assert len(findings) == 1, report.findings
    return findings[0]


@pytest.mark.parametrize("with_truth", [False, True])
def test_a_clean_scene_has_only_its_share_of_missing_depth(make: Make, with_truth: bool) -> None:
    report = check_sequence(make(with_truth=with_truth))
    assert [f.kind for f in report.findings] == ["missing_depth"]
    share = only(report, "missing_depth")
    assert share.severity == "info"
    assert share.value == pytest.approx(0.01, abs=0.002)
    assert "1.0 %" in share.message


@pytest.mark.parametrize("shift", [(4, 0), (8, 0), (0, -6), (-3, 3)])
def test_shifted_depth_is_measured(make: Make, shift: tuple[int, int]) -> None:
    finding = only(check_sequence(make(shift=shift)), "depth_shift")
    length = float(np.hypot(*shift))
    assert finding.value == pytest.approx(length, abs=0.7)
    assert "shift" in finding.message
    assert f"{finding.value:.1f} px" in finding.message


@pytest.mark.parametrize("seed", range(20, 26))
def test_a_single_clean_frame_shows_no_shift(seed: int) -> None:
    measured = measure_shift([scene(seed)[0]])
    assert measured is not None
    assert measured.typical_px < 1.5


def test_colour_that_has_nothing_to_do_with_depth_says_nothing() -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    frame, _ = scene(1)
    assert measure_shift([replace(frame, rgb=noise)]) is None
    assert measure_shift([replace(frame, rgb=np.full_like(noise, 90))]) is None
    assert measure_shift([replace(frame, depth=np.full((HEIGHT, WIDTH), 0.8, np.float32))]) is None
    assert measure_shift([replace(frame, depth=None)]) is None
    assert measure_shift([]) is None


def test_the_real_frames_are_about_7_px_off(shared: Path) -> None:
    sequence = open_sequence(shared / "data" / "real")
    report = check_sequence(sequence)
    finding = only(report, "depth_shift")
    assert finding.value == pytest.approx(7.0, abs=1.0)
    assert "shift" in finding.message
    share = only(report, "missing_depth")
    assert share.value == pytest.approx(0.431, abs=0.002)
    assert "43.1 %" in share.message
    assert {f.kind for f in report.findings} == {"depth_shift", "missing_depth"}


def test_the_real_lens_explains_the_scale_of_the_shift(shared: Path, tmp_path: Path) -> None:
    real = shared / "data" / "real"
    for name in ("rgb", "depth"):
        (tmp_path / name).symlink_to(real / name)
    camera = json.loads((real / "camera.json").read_text())
    camera["distortion"] = [0.109, -0.124, 0.0, 0.0, 0.067]
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    bare, lens = (open_sequence(folder) for folder in (real, tmp_path))
    before, after = (measure_shift([s[place] for place in range(3)]) for s in (bare, lens))
    assert before is not None
    assert after is not None
    assert before.scale == pytest.approx(1.016, abs=0.003)
    assert after.scale == pytest.approx(1.0, abs=0.004)
    assert after.typical_px < before.typical_px - 1.0


def scaled_depth(factor: float) -> Callable[[Frame], Frame]:
    def change(frame: Frame) -> Frame:
        assert frame.depth is not None
        return replace(frame, depth=frame.depth * np.float32(factor))

    return change


def changed_camera(edit: Callable[[np.ndarray], np.ndarray]) -> Callable[[Frame], Frame]:
    return lambda frame: replace(frame, camera=replace(CAMERA, K=edit(K.copy())))


@pytest.mark.parametrize(
    ("factor", "with_truth", "value", "words"),
    [
        (1000.0, False, 800.0, r"depth_scale .* by 0.001"),
        (0.001, False, 0.0008, r"depth_scale .* by 1000"),
        (0.25, True, 0.25, r"Divide depth_scale by 0.25"),
        (5.0, True, 5.0, r"Divide depth_scale by 5"),
    ],
)
def test_a_wrong_depth_unit_is_named(
    make: Make, factor: float, with_truth: bool, value: float, words: str
) -> None:
    report = check_sequence(make(scaled_depth(factor), with_truth=with_truth))
    finding = only(report, "depth_unit")
    assert finding.severity == "error"
    assert finding.value == pytest.approx(value, rel=0.03)
    assert [f.kind for f in report.findings if f.severity == "error"] == ["depth_unit"]
    assert re.search(words, finding.message)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda K: np.diag([5.0, 5.0, 1]) @ K, "lies outside the image"),
        (lambda K: np.diag([2.0, 2.0, 1]) @ K, "2 times as large"),
        (lambda K: np.diag([0.5, 0.5, 1]) @ K, "0.5 times as large"),
        (lambda K: K + np.array([[0, 0, 150.0], [0, 0, 0], [0, 0, 0]]), "far from the centre"),
        (lambda K: K + np.diag([5000.0, 5000.0, 0]), "degrees across"),
        (lambda K: K - np.diag([500.0, 500.0, 0]), "degrees across"),
        (lambda K: K + np.diag([120.0, 0, 0]), "fx and fy differ by 20 %"),
    ],
)
def test_intrinsics_that_no_camera_has_are_named(
    make: Make, edit: Callable[[np.ndarray], np.ndarray], words: str
) -> None:
    report = check_sequence(make(changed_camera(edit)))
    assert words in only(report, "intrinsics").message


@pytest.mark.parametrize(
    ("edit", "value"),
    [
        (lambda K: K @ np.diag([1.2, 1.2, 1]), 1 / 1.2),
        (lambda K: K @ np.diag([0.88, 0.88, 1]), 1 / 0.88),
        (lambda K: K + np.array([[0, 0, 40.0], [0, 0, 0], [0, 0, 0]]), 40.0),
    ],
)
def test_intrinsics_that_truth_contradicts_are_named(
    make: Make, edit: Callable[[np.ndarray], np.ndarray], value: float
) -> None:
    report = check_sequence(make(changed_camera(edit), with_truth=True))
    finding = only(report, "intrinsics")
    assert finding.severity == "error"
    assert finding.value == pytest.approx(value, rel=0.06)
    assert not found(report, "mesh_unit")


def test_a_part_that_is_elsewhere_is_named_instead_of_the_camera(make: Make) -> None:
    """The truth has the block above the plate, as a wrong state label does; it lies on the table."""
    clean = make(with_truth=True)
    truths: list[FrameTruth | None] = []
    for truth in clean.truths:
        assert truth is not None
        T_camera_block = truth.T_camera_part["plate"].copy()
        T_camera_block[2, 3] -= 0.09  # leaves 25 mm of air between them
        truths.append(
            replace(truth, T_camera_part={**truth.T_camera_part, "block": T_camera_block})
        )
    report = check_sequence(replace(clean, truths=tuple(truths)))
    finding = only(report, "part_pose")
    assert finding.severity == "warning"
    assert finding.message.startswith("block is not where the truth has it")
    assert finding.message.endswith(
        "or the state that says where it is; frames looked at: 0, 1, 2."
    )
    assert not found(report, "intrinsics")
    assert not found(report, "mesh_unit")


@pytest.mark.parametrize(
    ("scales", "with_truth", "name"),
    [
        ({"block": 10.0}, True, "block"),
        ({"block": 0.1}, True, "block"),
        ({"plate": 25.4}, True, "plate"),
        ({"plate": 0.1, "block": 0.1, "bar": 0.1}, False, "plate"),
        ({"plate": 10.0, "block": 10.0, "bar": 10.0}, False, "plate"),
        ({"bar": 0.02}, False, "bar"),
    ],
)
def test_a_mesh_in_the_wrong_unit_is_named(
    make: Make, scales: dict[str, float], with_truth: bool, name: str
) -> None:
    report = check_sequence(make(with_truth=with_truth, assembly=make_assembly(scales)))
    findings = found(report, "mesh_unit")
    assert findings, report.findings
    assert all(name in f.message for f in findings)
    assert all("unit" in f.message for f in findings)
    assert not found(report, "intrinsics")
    assert not found(report, "depth_unit")


def test_depth_in_tenths_of_millimetres_is_not_put_down_to_the_mesh_alone(make: Make) -> None:
    report = check_sequence(make(scaled_depth(10.0), assembly=make_assembly()))
    message = only(report, "mesh_unit").message
    assert "depth or mesh is in a wrong unit. If the table is about 0.8 m away, not 8 m" in message
    assert "multiply depth_scale (millimetres per unit) by 0.1. If not: set 'unit'" in message
    # Without an assembly nothing tells which it is, but that it is far for a table.
    far = only(check_sequence(make(scaled_depth(10.0))), "depth_unit")
    assert (far.severity, far.value) == ("info", pytest.approx(8.0, rel=0.03))
    assert "with a tenth of it, it is 0.8 m" in far.message
    # At a table's distance it is the mesh.
    small = make_assembly(dict.fromkeys(SIZES, 0.1))
    message = only(check_sequence(make(assembly=small)), "mesh_unit").message
    assert "depth" not in message


@pytest.mark.parametrize(("metres", "said"), [(0.0000125, True), (0.0125, False), (0.0, False)])
def test_offsets_of_states_in_metres_are_named(make: Make, metres: float, said: bool) -> None:
    boxes = make_assembly()
    joined = transform_from(np.eye(3), np.array([0, 0, metres]))
    state = State(1, "block on", {"plate": np.eye(4), "block": joined})
    report = check_sequence(make(assembly=replace(boxes, states=(*boxes.states, state))))
    messages = [finding.message for finding in found(report, "state_unit")]
    assert len(messages) == said
    for message in messages:
        assert "block on put every part within 0.013 mm" in message
        assert "look like metres" in message


def test_a_mesh_far_from_its_origin_is_named(make: Make) -> None:
    boxes = make_assembly()
    block = boxes.parts["block"]
    for diameters, said in ((2.0, False), (20.0, True)):
        away = np.array([diameters * block.diameter, 0.0, 0.0])
        mesh = replace(block.mesh, vertices=block.mesh.vertices + away)
        parts = {**boxes.parts, "block": replace(block, mesh=mesh)}
        report = check_sequence(make(assembly=replace(boxes, parts=parts)))
        messages = [finding.message for finding in found(report, "far_origin")]
        assert len(messages) == said
        assert all("origin of part 'block' lies" in message for message in messages)


def test_no_depth_at_all_is_said(make: Make) -> None:
    report = check_sequence(make(lambda frame: replace(frame, depth=None)))
    finding = only(report, "missing_depth")
    assert (finding.severity, finding.value) == ("warning", 1.0)


def test_depth_of_nothing_but_zeros_is_said(make: Make) -> None:
    report = check_sequence(
        make(lambda frame: replace(frame, depth=np.zeros((480, 640), np.float32)))
    )
    finding = only(report, "missing_depth")
    assert (finding.severity, finding.value) == ("warning", 1.0)
    assert "All depth pixels are 0 in all" in finding.message
    assert "no depth was recorded" in finding.message


@pytest.mark.parametrize(
    ("columns", "every", "severity", "words"),
    [
        (320, 480, "info", "50.0 % outside the depth camera's view, 1.2 % holes"),
        (400, 480, "warning", "Keep the work within the depth camera's view"),
        (0, 4, "warning", "So many holes come from dark or shiny surfaces"),
    ],
)
def test_the_blind_rim_is_told_from_holes(
    make: Make, columns: int, every: int, severity: str, words: str
) -> None:
    def blind(frame: Frame) -> Frame:
        assert frame.depth is not None
        depth = frame.depth.copy()
        depth[:, :columns] = 0
        # Stripes that move from frame to frame: holes, not a rim.
        depth[frame.index % every :: every, 1:-1] = 0
        return replace(frame, depth=depth)

    finding = only(check_sequence(make(blind)), "missing_depth")
    assert finding.severity == severity
    assert words in finding.message


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene folder of 640 x 480 images: frames 0, 1, 2, 4, 5."""
    folder = tmp_path_factory.mktemp("written")
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
    for index in (0, 1, 2, 4, 5):
        frame, _ = scene(index)
        assert frame.depth is not None
        cv2.imwrite(str(folder / "rgb" / f"{index:06d}.png"), frame.rgb[..., ::-1])
        raw = np.rint(frame.depth * 1000).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / f"{index:06d}.png"), raw)
    fields = {"fx": 600.0, "fy": 600.0, "cx": 318.0, "cy": 243.0, "width": WIDTH, "height": HEIGHT}
    (folder / "camera.json").write_text(json.dumps(fields))
    return folder


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    """The scene folder, to change."""
    return shutil.copytree(written, tmp_path, dirs_exist_ok=True)


def test_missing_frames_are_named(folder: Path) -> None:
    (folder / "depth" / "000005.png").rename(folder / "depth" / "000009.png")
    (folder / "rgb" / "cover.png").write_bytes((folder / "rgb" / "000000.png").read_bytes())
    messages = [f.message for f in found(check_sequence(open_sequence(folder)), "missing_frames")]
    assert len(messages) == 4
    text = "\n".join(messages)
    assert "1 missing frame between 0 and 5: 3." in text
    assert "1 of 5 colour images have no depth image of their number: 5." in text
    assert "1 depth image without a colour image of that number, not shown: 9." in text
    assert "1 image not used, for want of a number as name: rgb/cover.png." in text


@pytest.mark.parametrize("step", [1, 5])
def test_missing_frames_are_counted_however_many_there_are(step: int) -> None:
    """One image that is named by date and time lies among the frames."""
    indices = (0, step, 2 * step, 4 * step, 5 * step, 20240131123000)
    (finding,) = (f for f in check_numbering(indices) if f.kind == "missing_frames")
    count = 1 + len(range(6 * step, indices[-1], step))
    named = ", ".join(str(k * step) for k in (3, 6, 7, 8, 9, 10))
    assert finding.value == count
    assert f"{count} missing frames between 0 and {indices[-1]}: {named} and {count - 6} more." in (
        finding.message
    )


def test_images_that_were_cut_off_are_named_wherever_they_are(folder: Path) -> None:
    """A dozen frames are decoded; of the others the end of the file is looked at."""
    for number in range(6, 40):
        for kind in ("rgb", "depth"):
            shutil.copy(folder / kind / "000000.png", folder / kind / f"{number:06d}.png")
    assert not found(check_sequence(open_sequence(folder)), "broken_images")
    looked_at = {open_sequence(folder).frame_indices[i] for i in spread(39, 12)}
    first, second = sorted(set(range(6, 40)) - looked_at)[:2]
    for kind, number in (("depth", first), ("rgb", second)):
        file = folder / kind / f"{number:06d}.png"
        file.write_bytes(file.read_bytes()[:-20])
    (finding,) = found(check_sequence(open_sequence(folder)), "broken_images")
    assert finding.severity == "error"
    assert (
        f"2 images cut off before the end: rgb/{second:06d}.png, depth/{first:06d}.png"
        in finding.message
    )


def test_a_file_of_another_kind_than_its_name_says_is_not_called_cut_off(folder: Path) -> None:
    for number in (1, 4):
        bitmap = cv2.imencode(".bmp", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].tobytes()
        (folder / "rgb" / f"{number:06d}.png").write_bytes(bitmap)
    jpeg = cv2.imencode(".jpg", np.zeros((HEIGHT, WIDTH, 3), np.uint8))[1].tobytes()
    (folder / "rgb" / "000005.png").write_bytes(jpeg + bytes(2000))  # is read all the same
    (finding,) = found(check_sequence(open_sequence(folder)), "broken_images")
    assert (finding.severity, finding.value) == ("error", 2.0)
    assert finding.message == (
        "2 images not read: rgb/000001.png, rgb/000004.png. Each is a BMP file, whatever its name "
        "says: save it as PNG (another name alone changes nothing)."
    )


def test_depth_in_npy_is_looked_over_as_depth_in_png(folder: Path) -> None:
    before = check_sequence(open_sequence(folder)).findings
    for file in (folder / "depth").iterdir():
        np.save(file.with_suffix(".npy"), read_stored(file))
        file.unlink()
    assert check_sequence(open_sequence(folder)).findings == before
    np.save(folder / "depth" / "000004.npy", np.zeros((HEIGHT // 2, WIDTH // 2), np.uint16))
    finding = only(check_sequence(open_sequence(folder)), "size_mismatch")
    assert "depth images not 640 x 480 as the others: depth/000004.npy (320 x 240)" in (
        finding.message
    )


def test_colour_that_others_show_turned_is_told(folder: Path) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    for number, tagged in ((1, True), (2, False)):
        file = folder / "rgb" / f"{number:06d}.png"
        picture = Image.open(file)
        file.unlink()
        picture.save(file.with_suffix(".jpg"), exif=exif if tagged else Image.Exif())
    finding = only(check_sequence(open_sequence(folder)), "orientation")
    assert (finding.severity, finding.value) == ("warning", 1.0)
    assert "1 colour image with an EXIF orientation" in finding.message
    assert "rgb/000001.jpg (6). Pixels are used as they are stored" in finding.message


def test_a_float_tiff_called_png_is_told_as_what_it_is(folder: Path) -> None:
    for file in (folder / "depth").iterdir():
        metres = cv2.imencode(".tiff", np.full((HEIGHT, WIDTH), 0.8, np.float32))[1]
        file.write_bytes(metres.tobytes())
    (finding,) = found(check_sequence(open_sequence(folder)), "broken_images")
    assert "000.png is 32 bit float with 1 channel; depth must be a PNG, TIFF" in finding.message
    assert "Not read in 5 of 5 frames looked at" in finding.message
    assert "np.nan_to_num(1000 * depth).round().astype(np.uint16)" in finding.message


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.zeros((HEIGHT, WIDTH), np.uint8), "8 bit with 1 channel; .*: 8 bits have lost it"),
        (np.zeros((HEIGHT, WIDTH, 3), np.uint16), "16 bit with 3 channels; .* equal, save one of"),
    ],
)
def test_depth_of_a_wrong_kind_is_told_once_with_its_own_remedy(
    folder: Path, image: np.ndarray, words: str
) -> None:
    for file in sorted((folder / "depth").iterdir())[1:]:
        cv2.imwrite(str(file), image)
    (finding,) = found(check_sequence(open_sequence(folder)), "broken_images")
    assert finding.value == 4.0
    assert finding.message.startswith(f"Not read in 4 of 5 frames looked at: {folder}/depth/000001")
    assert re.search(words, finding.message)
    assert "again, or take it out" not in finding.message


def test_intrinsics_that_change_within_a_sequence_are_named(folder: Path) -> None:
    assert not found(check_sequence(open_sequence(folder)), "several_cameras")
    (folder / "camera.json").unlink()
    cameras = {
        str(i): {"cam_K": [600.0, 0, 218.0 if i in (2, 5) else 318.0, 0, 600.0, 243.0, 0, 0, 1]}
        for i in (0, 1, 2, 4, 5)
    }
    cameras["1"]["cam_K"][0] += 1e-6  # as numbers are rounded
    (folder / "scene_camera.json").write_text(json.dumps(cameras))
    finding = only(check_sequence(open_sequence(folder)), "several_cameras")
    assert finding.severity == "warning"
    assert "2 frames of 5 have other intrinsics than frame 0, frame 2 first" in finding.message


def test_numbers_that_rise_by_a_step_have_no_gap_but_the_step_is_told(folder: Path) -> None:
    for number, name in enumerate(sorted(p.name for p in (folder / "rgb").iterdir())):
        for kind in ("rgb", "depth"):
            (folder / kind / name).rename(folder / kind / f"{1000 + 10 * number}.png")
    report = check_sequence(open_sequence(folder))
    assert not found(report, "missing_frames")
    (step,) = found(report, "frame_step")
    assert (step.severity, step.value) == ("info", 10.0)


@pytest.mark.parametrize("start", [0, 1_700_000_000_000])
def test_numbers_that_are_times_are_told_as_such(start: int) -> None:
    """Milliseconds at 30 frames a second; three frames are missing after the tenth."""
    times = [start + round(1000 * i / 30) for i in range(30)]
    (told,) = check_numbering(times)
    assert (told.kind, told.severity, told.value) == ("frame_step", "info", 33.0)
    assert "look like times, about 33 apart" in told.message
    _, gap = check_numbering(times[:10] + times[13:])
    assert (gap.kind, gap.value) == ("missing_frames", 3.0)
    assert f"About 3 missing frames by their times, after {times[9]}." in gap.message


def test_even_steps_are_times_where_no_recording_is_as_long() -> None:
    (told,) = check_numbering([1_700_000_000 + 40 * i for i in range(9)])
    assert "look like times, about 40 apart" in told.message
    (told,) = check_numbering([40 * i for i in range(9)])
    assert "steps of 40" in told.message
    assert not list(check_numbering([1_700_000_000]))


@pytest.mark.parametrize("kind", ["rgb", "depth"])
def test_sizes_that_differ_are_a_finding_not_an_error(folder: Path, kind: str) -> None:
    channels = {"rgb": (np.uint8, 3), "depth": (np.uint16, 1)}[kind]
    image = np.zeros((240, 320, channels[1]), dtype=channels[0]).squeeze()
    cv2.imwrite(str(folder / kind / "000002.png"), image)
    report = check_sequence(Prefetcher(open_sequence(folder)))
    finding = only(report, "size_mismatch")
    assert (finding.severity, finding.value) == ("error", 1.0)
    assert "not 640 x 480 as the others" in finding.message
    assert f"{kind}/000002.png (320 x 240)" in finding.message
    assert report.findings[0] is finding


def test_another_size_is_seen_in_frames_that_are_not_looked_at(folder: Path) -> None:
    for kind in ("rgb", "depth"):
        first = folder / kind / "000000.png"
        for number in range(100, 140):
            shutil.copy(first, folder / kind / f"{number:06d}.png")
    sequence = open_sequence(folder)
    unseen = max(set(range(len(sequence))) - set(spread(len(sequence), 12)))
    file = folder / "depth" / f"{sequence.frame_indices[unseen]:06d}.png"
    cv2.imwrite(str(file), np.full((240, 320), 700, np.uint16))
    message = only(check_sequence(sequence), "size_mismatch").message
    assert "depth images not 640 x 480 as the others" in message
    assert f"depth/{file.name} (320 x 240)" in message


@pytest.mark.parametrize(
    ("center", "words"),
    [
        ((159.5, 120.0), "is the centre of these: set 'width' and 'height' to 320 and 240"),
        ((318.0, 243.0), "multiply fx, fy, cx and cy by 0.5, and set 'width' and 'height'"),
        ((470.0, 120.0), "give the intrinsics of 320 x 240 images"),
    ],
)
def test_of_two_sizes_the_one_to_change_is_named(
    folder: Path, center: tuple[float, float], words: str
) -> None:
    for file in (folder / "rgb").iterdir():
        cv2.imwrite(str(file), np.zeros((240, 320, 3), np.uint8))
    camera = json.loads((folder / "camera.json").read_text())
    camera |= dict(zip(("cx", "cy"), center, strict=True))
    (folder / "camera.json").write_text(json.dumps(camera))
    report = check_sequence(open_sequence(folder))
    finding = only(report, "size_mismatch")
    assert (finding.severity, finding.value) == ("error", 0.5)
    assert (
        "The camera file says 640 x 480, but all images looked at are 320 x 240" in finding.message
    )
    assert words in finding.message
    assert not found(report, "intrinsics")


def test_distractors_are_counted(folder: Path) -> None:
    entry = {"cam_R_m2c": np.eye(3).reshape(-1).tolist(), "cam_t_m2c": [0, 0, 800]}
    names = ["plate", "mug", "spoon", "mug", "plate"]
    gt = {str(i): [{**entry, "obj_id": name} for name in names] for i in (0, 1)}
    (folder / "scene_gt.json").write_text(json.dumps(gt))
    report = check_sequence(open_sequence(folder, assembly=make_assembly()))
    strangers, repeats = found(report, "distractors")
    assert (strangers.severity, strangers.value) == ("info", 2.0)
    assert "(6 entries): mug, spoon" in strangers.message
    assert repeats.value == 2.0
    assert "Give repeated pieces names of their own" in repeats.message
    assert not found(check_sequence(open_sequence(folder)), "distractors")


@pytest.mark.parametrize(
    ("kind", "is_drawn"), [("scenes", True), ("packs", True), ("sequence", False)]
)
def test_copies_in_drawn_images_are_no_fault(folder: Path, kind: str, is_drawn: bool) -> None:
    entry = {"cam_R_m2c": np.eye(3).reshape(-1).tolist(), "cam_t_m2c": [0, 0, 800]}
    gt = {"0": [{**entry, "obj_id": "plate"}] * 3}
    (folder / "scene_gt.json").write_text(json.dumps(gt))
    about = {"assembly": "boxes", "fps": 0, "kind": kind}
    (folder / "sequence.json").write_text(json.dumps(about))
    finding = only(check_sequence(open_sequence(folder, assembly=make_assembly())), "distractors")
    assert "2 entries of the truth repeat a part" in finding.message
    assert ("show copies on purpose" in finding.message) == is_drawn
    assert ("names of their own" in finding.message) == (not is_drawn)


def test_an_assembly_that_is_not_there_is_named(folder: Path) -> None:
    (folder / "sequence.json").write_text(json.dumps({"assembly": "gone"}))
    assert "'gone'" in only(check_sequence(open_sequence(folder)), "missing_assembly").message


def test_every_unreadable_image_is_named_and_the_others_are_checked(folder: Path) -> None:
    start, end = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
    for number in (2, 4):
        (folder / "rgb" / f"{number:06d}.png").write_bytes(start + b"no image" + end)
    (folder / "depth" / "000001.png").write_bytes(b"broken")
    report = check_sequence(open_sequence(folder))
    broken = found(report, "broken_images")
    assert [f.severity for f in broken] == ["error"] * 3
    cut, first, second = (f.message for f in broken)
    assert "1 image cut off before the end: depth/000001.png." in cut
    assert "rgb/000002.png is corrupt" in first
    assert "rgb/000004.png is corrupt" in second
    assert only(report, "missing_depth").value == pytest.approx(0.01, abs=0.002)


def test_the_report_is_plain_json_with_the_gravest_first(make: Make) -> None:
    report = check_sequence(make(scaled_depth(1000.0)))
    content = json.loads(json.dumps(report.to_json(), allow_nan=False))
    assert (content["sequence"], content["frames"], content["frames_looked_at"]) == ("memory", 3, 3)
    assert [f["severity"] for f in content["findings"]] == ["error", "info"]
    assert set(content["findings"][0]) == {"kind", "severity", "message", "value"}


def test_it_tells_how_far_it_is(make: Make) -> None:
    told: list[tuple[int, int, str]] = []
    check_sequence(make(with_truth=True), progress=lambda *step: told.append(step))
    by_kind = {what: [step[:2] for step in told if step[2] == what] for *_, what in told}
    assert list(by_kind) == ["reading", "depth against colour", "depth against truth", ""]
    assert by_kind["reading"] == [(1, 3), (2, 3), (3, 3)]
    assert by_kind["depth against colour"] == [(i, 3 + SCALES) for i in range(1, 4 + SCALES)]
    assert told[-1] == (3, 3, "")


def test_at_most_a_dozen_frames_are_read(make: Make) -> None:
    report = check_sequence(make(count=15))
    assert (report.frames, report.frames_looked_at) == (15, 12)
