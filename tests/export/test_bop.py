from __future__ import annotations

import copy
import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.data.assembly_writer import write_assembly
from asdfviz.data.prefetch import Prefetcher
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Assembly, Frame, FrameTruth, Sequence
from asdfviz.errors import SequenceError
from asdfviz.export.bop import export_bop
from asdfviz.export.bop_content import scene_gt
from asdfviz.export.readable import told_left_out
from asdfviz.geometry.transforms import rotation_angle
from asdfviz.train.dataset import shown_subject, subjects_of

Truth = dict[int, FrameTruth]


def assert_same_truth(read: Mapping[int, FrameTruth], written: Truth) -> None:
    assert set(read) == set(written)
    for index, expected in written.items():
        found = read[index]
        assert (found.state, found.is_error, found.attached, found.error) == (
            expected.state,
            expected.is_error,
            expected.attached,
            expected.error,
        )
        assert dict(found.visible) == dict(expected.visible)
        assert found.unchecked == expected.unchecked
        assert set(found.T_camera_part) == set(expected.T_camera_part)
        for name, T in expected.T_camera_part.items():
            T_found = found.T_camera_part[name]
            assert np.abs(T_found[:3, 3] - T[:3, 3]).max() < 1e-9
            assert rotation_angle(T_found[:3, :3].T @ T[:3, :3]) < 1e-9


def read_back(folder: Path, assembly: Assembly) -> tuple[list[Frame], Truth]:
    sequence = open_sequence(folder, assembly=assembly)
    truths = [sequence.truth(place) for place in range(len(sequence))]
    return [sequence[i] for i in range(len(sequence))], {
        t.frame_index: t for t in truths if t is not None
    }


def assert_same_frames(read: list[Frame], written: Sequence) -> None:
    assert [frame.index for frame in read] == list(written.frame_indices)
    for place, frame in enumerate(read):
        expected = written[place]
        np.testing.assert_array_equal(frame.rgb, expected.rgb)
        np.testing.assert_array_equal(frame.camera.K, expected.camera.K)
        assert (frame.depth is None) == (expected.depth is None)
        if frame.depth is not None and expected.depth is not None:
            np.testing.assert_allclose(frame.depth, expected.depth, atol=1e-6)


def gone_in(frame: int, assembly: Assembly) -> set[tuple[int, str]]:
    return {(frame, part) for part in assembly.parts}


def test_a_state_alone_does_not_say_that_no_part_is_there(
    memory: Sequence, assembly: Assembly, tmp_path: Path
) -> None:
    only = {i: FrameTruth(i, {}, state=1, is_error=False) for i in memory.frame_indices[:2]}
    first, second = only
    export_bop(memory, only, tmp_path / "out", gone={(first, "jaw")} | gone_in(second, assembly))
    assert json.loads((tmp_path / "out" / "scene_gt.json").read_text()) == {str(second): []}
    read = read_back(tmp_path / "out", assembly)[1]
    assert {i: frame.state for i, frame in read.items()} == {first: 1, second: 1}
    export_bop(memory, read, tmp_path / "again")
    assert json.loads((tmp_path / "again" / "scene_gt.json").read_text()) == {str(second): []}


def test_unchecked_parts_come_back_and_go_with_the_next_export(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    partly = {**truth, 0: replace(truth[0], unchecked=("jaw",))}
    export_bop(memory, partly, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "unchecked.json").read_text()) == {"0": ["jaw"]}
    assert_same_truth(read_back(tmp_path / "out", assembly)[1], partly)
    export_bop(memory, truth, tmp_path / "out")
    assert not (tmp_path / "out" / "unchecked.json").exists()


def test_what_is_exported_reads_back(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    seen: list[tuple[int, int]] = []
    export_bop(memory, truth, tmp_path / "out", progress=lambda *done: seen.append(done))
    assert seen == [(1, 3), (2, 3), (3, 3)]
    frames, found = read_back(tmp_path / "out", assembly)
    assert_same_truth(found, truth)
    assert_same_frames(frames, memory)
    assert open_sequence(tmp_path / "out").format == "gbot"


def test_parts_can_go_by_their_numbers(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    with pytest.raises(SequenceError, match="'base <1>' has no obj_id"):
        scene_gt(truth, memory, "numbers")
    parts = {name: replace(p, obj_id=i + 4) for i, (name, p) in enumerate(assembly.parts.items())}
    numbered = replace(assembly, parts=parts)
    recording = copy.copy(memory)
    vars(recording)["assembly"] = numbered
    export_bop(recording, truth, tmp_path / "out", ids="numbers")
    _, found = read_back(tmp_path / "out", numbered)
    assert_same_truth(found, truth)
    assert open_sequence(tmp_path / "out", assembly=numbered).format == "bop"
    assert set(json.loads((tmp_path / "out" / "models_info.json").read_text())) == {"4", "5"}
    vars(recording)["assembly"] = None
    with pytest.raises(SequenceError, match="no assembly that has numbers"):
        scene_gt(truth, recording, "numbers")


def test_an_exported_folder_exports_again_byte_by_byte(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    export_bop(memory, truth, tmp_path / "one")
    first = open_sequence(tmp_path / "one", assembly=assembly)
    # The prefetcher that the app holds must not hide the files behind it.
    fetcher = Prefetcher(first)
    export_bop(fetcher, read_back(tmp_path / "one", assembly)[1], tmp_path / "two")
    fetcher.close()
    for name in ("rgb/000005.png", "depth/000005.png", "scene_camera.json", "scene_gt_info.json"):
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()
    frames, found = read_back(tmp_path / "two", assembly)
    assert_same_truth(found, truth)
    assert_same_frames(frames, memory)
    assert open_sequence(tmp_path / "two").fps == 30.0


@pytest.mark.parametrize("suffix", [".npy", ".tiff"])
def test_depth_of_other_files_is_exported_as_png_with_the_same_values(
    memory: Sequence, tmp_path: Path, suffix: str
) -> None:
    export_bop(memory, {}, tmp_path / "one")
    for file in (tmp_path / "one" / "depth").iterdir():
        raw = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        assert raw is not None
        np.save(file.with_suffix(".npy"), raw)
        cv2.imwrite(str(file.with_suffix(".tiff")), raw)
        file.unlink()
        file.with_suffix({".npy": ".tiff", ".tiff": ".npy"}[suffix]).unlink()
    export_bop(open_sequence(tmp_path / "one"), {}, tmp_path / "two")
    assert {file.suffix for file in (tmp_path / "two" / "depth").iterdir()} == {".png"}
    again = open_sequence(tmp_path / "two")
    assert_same_frames([again[place] for place in range(len(again))], memory)


def test_images_whose_lens_was_undone_are_written_undistorted(
    memory: Sequence, assembly: Assembly, tmp_path: Path
) -> None:
    export_bop(memory, {}, tmp_path / "one")
    camera = json.loads((tmp_path / "one" / "camera.json").read_text())
    camera["distortion"] = [0.3, -0.1, 0.0, 0.0, 0.0]
    (tmp_path / "one" / "camera.json").write_text(json.dumps(camera))
    lens = open_sequence(tmp_path / "one", assembly=assembly)
    export_bop(lens, {}, tmp_path / "two")
    frames, found = read_back(tmp_path / "two", assembly)
    assert found == {}
    assert_same_frames(frames, lens)
    assert np.abs(frames[0].rgb.astype(int) - memory[0].rgb).max() > 20
    # Exported before without the lens: the old image of the same number must go.
    image = (tmp_path / "two" / "rgb" / "000000.png").read_bytes()
    cv2.imwrite(str(tmp_path / "two" / "rgb" / "000000.jpg"), memory[0].rgb)
    export_bop(lens, {}, tmp_path / "two")
    assert not (tmp_path / "two" / "rgb" / "000000.jpg").exists()
    assert (tmp_path / "two" / "rgb" / "000000.png").read_bytes() == image
    assert len(open_sequence(tmp_path / "two")) == 3


def test_models_info_is_in_millimetres(memory: Sequence, tmp_path: Path) -> None:
    export_bop(memory, {}, tmp_path / "out")
    info = json.loads((tmp_path / "out" / "models_info.json").read_text())
    assert set(info) == {"base <1>", "jaw"}
    jaw = info["jaw"]
    assert jaw["diameter"] == pytest.approx(np.hypot(40, 50))
    assert (jaw["min_x"], jaw["size_z"]) == (0.0, pytest.approx(50.0))
    row = [-1, 0, 0, 10, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    assert jaw["symmetries_discrete"] == [pytest.approx(row, abs=1e-12)]
    assert jaw["symmetries_continuous"] == [{"axis": [0, 1, 0], "offset": [0, 0, 2.0]}]
    assert "symmetries_discrete" not in info["base <1>"]


def test_depth_too_far_for_fine_steps_is_written_in_millimetres(
    memory: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    far = replace(memory[0], depth=np.full((48, 64), 9.1234, dtype=np.float32))
    monkeypatch.setattr(type(memory), "__getitem__", lambda self, place: far)
    export_bop(memory, {}, tmp_path / "out")
    depth = open_sequence(tmp_path / "out")[0].depth
    assert depth is not None
    np.testing.assert_allclose(depth, 9.123, atol=1e-6)


def test_an_earlier_export_is_replaced(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    export_bop(memory, truth, tmp_path / "out")
    changed = {5: replace(truth[5], state=0, visible={})}
    export_bop(memory, changed, tmp_path / "out")
    _, found = read_back(tmp_path / "out", assembly)
    assert_same_truth(found, changed)


def test_nothing_else_is_overwritten(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    export_bop(memory, truth, tmp_path / "data" / "one")
    source = open_sequence(tmp_path / "data" / "one", assembly=assembly)
    before = {p: p.read_bytes() for p in (tmp_path / "data").rglob("*") if p.is_file()}
    (tmp_path / "link").symlink_to(tmp_path / "data" / "one")
    for target in ("data/one", "data", "data/one/rgb", "link"):
        with pytest.raises(SequenceError, match="lies over the sequence"):
            export_bop(source, truth, tmp_path / target)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("dear")
    for target, message in (("mine", "is not empty"), ("mine/thesis.txt", "is a file")):
        with pytest.raises(SequenceError, match=message):
            export_bop(source, truth, tmp_path / target)
    (tmp_path / "mine" / "sequence.json").write_text("{}")
    with pytest.raises(SequenceError, match="no earlier export"):
        export_bop(source, truth, tmp_path / "mine")
    assert before == {p: p.read_bytes() for p in (tmp_path / "data").rglob("*") if p.is_file()}
    assert sorted(p.name for p in (tmp_path / "mine").iterdir()) == ["sequence.json", "thesis.txt"]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({2: FrameTruth(2, {}, 0)}, r"frame 2, which memory does not have"),
        ({0: FrameTruth(0, {"nut": np.eye(4)}, 0)}, r"'nut' is no part of two; parts: base <1>"),
        ({0: FrameTruth(0, {"jaw": 2 * np.eye(4)}, 0)}, r"'jaw' is no rigid transform"),
    ],
)
def test_truth_that_does_not_fit_is_refused_before_anything_is_written(
    memory: Sequence, wrong: Truth, message: str, tmp_path: Path
) -> None:
    with pytest.raises(SequenceError, match=message):
        export_bop(memory, wrong, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_export_can_be_read_where_its_assembly_is_not(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    home = write_assembly(assembly, tmp_path / "home")
    vars(memory)["assembly"] = load_assembly(str(home))
    export_bop(memory, truth, tmp_path / "out")
    here = open_sequence(tmp_path / "out").assembly
    assert here is not None
    assert Path(here.path) == home
    subjects = subjects_of([here])
    assert shown_subject(tmp_path / "out", subjects) is subjects[0]  # and may be learnt from
    shutil.move(tmp_path / "out", tmp_path / "elsewhere" / "out")
    shutil.rmtree(tmp_path / "home")
    moved = open_sequence(tmp_path / "elsewhere" / "out")
    assert moved.assembly is not None
    assert list(moved.assembly.parts) == list(assembly.parts)
    assert shown_subject(Path(moved.path), subjects) is subjects[0]
    assert str(tmp_path / "home") not in (Path(moved.path) / "sequence.json").read_text()


def test_exporting_again_leaves_nothing_of_frames_that_are_gone(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    export_bop(memory, truth, tmp_path / "scene")
    source = open_sequence(tmp_path / "scene", assembly=assembly)
    known = {index: true for index, true in truth.items() if index in source.frame_indices}
    export_bop(source, known, tmp_path / "out")
    last = source.frame_indices[-1]
    for room in ("rgb", "depth"):
        for file in (tmp_path / "scene" / room).glob(f"{last:06d}.*"):
            file.unlink()
    fewer = open_sequence(tmp_path / "scene", assembly=assembly)
    assert last not in fewer.frame_indices
    export_bop(fewer, {i: t for i, t in known.items() if i != last}, tmp_path / "out")
    assert not list((tmp_path / "out").rglob(f"{last:06d}.*"))
    assert open_sequence(tmp_path / "out", assembly=assembly).frame_indices == fewer.frame_indices


def test_exporting_again_leaves_no_depth_that_the_source_lost(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    export_bop(memory, truth, tmp_path / "scene")
    source = open_sequence(tmp_path / "scene", assembly=assembly)
    export_bop(source, truth, tmp_path / "out")
    (tmp_path / "scene" / "depth" / "000005.png").unlink()
    source = open_sequence(tmp_path / "scene", assembly=assembly)
    export_bop(source, truth, tmp_path / "out")
    frames, _ = read_back(tmp_path / "out", assembly)
    assert_same_frames(frames, source)
    assert [frame.depth is None for frame in frames] == [False, True, True]


def test_a_broken_image_is_left_out_with_its_truth(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    export_bop(memory, truth, tmp_path / "scene")
    source = open_sequence(tmp_path / "scene", assembly=assembly)
    export_bop(source, truth, tmp_path / "out")
    broken = tmp_path / "scene" / "depth" / "000005.png"
    broken.write_bytes(broken.read_bytes()[:20])
    steps: list[tuple[int, int]] = []
    left_out = export_bop(source, truth, tmp_path / "out", progress=lambda *n: steps.append(n))
    assert list(left_out) == [5]
    assert broken.name in left_out[5]
    assert steps == [(1, 3), (2, 3), (3, 3)]
    assert not list((tmp_path / "out").rglob("000005.*"))
    frames, found = read_back(tmp_path / "out", assembly)
    assert [frame.index for frame in frames] == [0, 1]
    assert_same_truth(found, {0: truth[0]})


def test_the_poses_are_put_down_once(
    memory: Sequence, truth: Truth, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[object] = []

    def counted(*given: Any) -> dict[str, object]:
        made.append(given)
        return scene_gt(*given)

    monkeypatch.setattr("asdfviz.export.bop.scene_gt", counted)
    export_bop(memory, truth, tmp_path / "out")
    assert len(made) == 1


def test_where_no_image_can_be_read_nothing_is_written(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    export_bop(memory, truth, tmp_path / "scene")
    for image in (tmp_path / "scene" / "rgb").iterdir():
        image.write_bytes(image.read_bytes()[:20])
    source = open_sequence(tmp_path / "scene", assembly=assembly)
    with pytest.raises(SequenceError, match=r"no frame of scene can be read.*000000\.png"):
        export_bop(source, truth, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_which_error_it_is_is_kept(
    memory: Sequence, truth: Truth, assembly: Assembly, tmp_path: Path
) -> None:
    truth[5] = replace(truth[5], error="jaw lost")
    export_bop(memory, truth, tmp_path / "out")
    _, found = read_back(tmp_path / "out", assembly)
    assert_same_truth(found, truth)
    entries = json.loads((tmp_path / "out" / "states.json").read_text())
    assert [entry["name"] for entry in entries] == ["bare", "jaw lost"]


def test_frames_that_are_left_out_are_told_in_one_line() -> None:
    assert told_left_out({3: "3.png is broken"}) == (
        "1 frame left out with images that cannot be read: 3 (3.png is broken)"
    )
    assert "0, 1, 2, 3, 4, 5, 6, 7, 8, 9 and 2 more (x" in told_left_out(
        dict.fromkeys(range(12), "x")
    )
