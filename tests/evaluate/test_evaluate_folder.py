"""Saved runs judged from disk: the run's own truth, another truth, and inputs that changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
import yaml

from asdfviz.data.assembly import load_assembly
from asdfviz.data.hashes import assembly_sha256, sequence_sha256
from asdfviz.data.run_files import save_run
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import FramePrediction, Run
from asdfviz.errors import InputError, RunError, SequenceError
from asdfviz.evaluate.evaluate import evaluate_folder

MakePrediction = Callable[..., FramePrediction]
MakeRun = Callable[..., Run]

POSE = np.eye(4) + np.array([[0.0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0.4], [0, 0, 0, 0]])
SHIFTED = POSE + np.array([[0.0, 0, 0, 0.004], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]])


@dataclass(frozen=True)
class Case:
    """A scene, its assembly and a saved run on it."""

    scene: Path
    assembly: Path
    run_folder: Path
    run: Run


def write_truth(folder: Path, *, shift_mm: float = 0.0, with_visibility: bool = True) -> None:
    folder.mkdir(exist_ok=True)
    R = np.eye(3).ravel().tolist()
    entry = {"obj_id": "plate", "cam_R_m2c": R, "cam_t_m2c": [shift_mm, 0, 400]}
    gt = {str(i): [entry] for i in range(3)}
    states = [{"frame": i, "state": int(i == 2), "is_error": False} for i in range(3)]
    (folder / "scene_gt.json").write_text(json.dumps(gt))
    (folder / "states.json").write_text(json.dumps(states))
    if with_visibility:
        info = {str(i): [{"visib_fract": 0.9}] for i in range(3)}
        (folder / "scene_gt_info.json").write_text(json.dumps(info))


@pytest.fixture
def case(tmp_path: Path, make_prediction: MakePrediction, make_run: MakeRun) -> Case:
    models = tmp_path / "toy"
    models.mkdir()
    trimesh.creation.box((80, 40, 20)).subdivide().export(models / "plate.ply")
    description = {
        "name": "toy",
        "unit": "mm",
        "base": "plate",
        "parts": {"plate": {"mesh": "plate.ply"}},
        "states": [{"name": "bare"}, {"name": "turned"}],
    }
    (models / "assembly.yaml").write_text(yaml.safe_dump(description))
    scene = tmp_path / "scene"
    for room in ("rgb", "depth"):
        (scene / room).mkdir(parents=True)
    for i in range(3):
        cv2.imwrite(str(scene / "rgb" / f"{i:06d}.png"), np.full((48, 64, 3), i, dtype=np.uint8))
        cv2.imwrite(str(scene / "depth" / f"{i:06d}.png"), np.full((48, 64), 500, dtype=np.uint16))
    camera = {"cam_K": [60.0, 0, 31.5, 0, 60.0, 23.5, 0, 0, 1], "depth_scale": 1.0}
    (scene / "scene_camera.json").write_text(json.dumps({str(i): camera for i in range(3)}))
    write_truth(scene)
    assembly = load_assembly(models)
    run = make_run(
        [make_prediction(i, {"plate": POSE}) for i in range(3)],
        sequence=str(scene),
        assembly=str(models / "assembly.yaml"),
        hashes={"assembly": assembly_sha256(assembly), "sequence": sequence_sha256(scene)},
    )
    save_run(run, tmp_path / "run")
    return Case(scene, models / "assembly.yaml", tmp_path / "run", run)


def test_the_runs_own_truth(case: Case) -> None:
    report = evaluate_folder(case.run_folder)
    assert report["sequence"] == "scene"
    assert report["n_frames"] == 3
    assert report["mean"]["add_s_01d"] == 100
    assert report["mean"]["e_t_mm"] == pytest.approx(0, abs=1e-9)
    assert report["state"]["accuracy"] == 0
    assert "warnings" not in report


@pytest.mark.parametrize("protocol", ["strict", "gbot"])
def test_another_truth_without_visibility(case: Case, tmp_path: Path, protocol: str) -> None:
    write_truth(tmp_path / "corrected", shift_mm=4, with_visibility=False)
    report = evaluate_folder(
        case.run_folder,
        protocol=protocol,  # pyright: ignore[reportArgumentType]
        truth_folder=tmp_path / "corrected",
    )
    assert report["mean"]["e_t_mm"] == pytest.approx(4)
    assert report["parts"]["plate"]["n_visible"] == 3
    assert report["mean"]["detection_recall"] == 100


def test_a_pose_where_the_truth_has_no_part_is_a_false_positive(case: Case) -> None:
    """Frame 0 has the part, 1 an empty entry, 2 a state alone, which says nothing of parts."""
    for name in ("scene_gt.json", "scene_gt_info.json"):
        content = json.loads((case.scene / name).read_text())
        (case.scene / name).write_text(json.dumps({"0": content["0"], "1": []}))
    plate = evaluate_folder(case.run_folder)["parts"]["plate"]
    assert (plate["n_visible"], plate["false_positives"], plate["box_precision"]) == (1, 1, 50)


def test_what_changed_since_the_run_is_said(case: Case) -> None:
    with case.assembly.open("a") as file:
        file.write("\ntitle: Another\n")
    (case.scene / "rgb" / "000001.png").write_bytes(b"other")
    changed = evaluate_folder(case.run_folder)["warnings"]
    assert [str(case.assembly) in changed[0], str(case.scene) in changed[1]] == [True, True]
    save_run(replace(case.run, hashes={}), case.run_folder)
    assert "warnings" not in evaluate_folder(case.run_folder)


def test_objects_that_are_no_parts_are_named(case: Case, tmp_path: Path) -> None:
    write_truth(tmp_path / "other")
    file = tmp_path / "other" / "scene_gt.json"
    gt = json.loads(file.read_text())
    for frame in ("0", "2"):
        gt[frame].append({**gt[frame][0], "obj_id": "plato"})
    file.write_text(json.dumps(gt))
    (tmp_path / "other" / "scene_gt_info.json").unlink()
    report = evaluate_folder(case.run_folder, truth_folder=tmp_path / "other")
    (warning,) = report["warnings"]
    assert "2 entries of 'plato', which toy does not have" in warning


def test_the_hashes_are_those_that_a_run_keeps(case: Case) -> None:
    from asdfviz.run import input_hashes

    @dataclass(frozen=True)
    class Nothing:
        """A config without a network."""

    assembly = load_assembly(case.assembly)
    sequence = open_sequence(case.scene, assembly=assembly)
    assert input_hashes(sequence, assembly, Nothing()) == case.run.hashes


def test_no_truth_and_no_run(case: Case, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(SequenceError, match="holds no truth"):
        evaluate_folder(case.run_folder, truth_folder=empty)
    with pytest.raises(InputError):
        evaluate_folder(empty)


def test_the_truth_of_another_sequence_is_refused(case: Case, tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    states = [{"frame": 100 + i, "state": 0, "is_error": False} for i in range(3)]
    (other / "states.json").write_text(json.dumps(states))
    said = rf"{case.run_folder} holds frames 0 to 2, the truth of {other} frames 100 to 102: they share"
    with pytest.raises(RunError, match=said):
        evaluate_folder(case.run_folder, truth_folder=other)


def test_what_does_not_fit_names_the_run_and_what_it_is_judged_by(
    case: Case, tmp_path: Path
) -> None:
    other, run = tmp_path / "other", case.run_folder
    other.mkdir()
    (other / "states.json").write_text('[{"frame": 0, "state": 7}]')
    with pytest.raises(SequenceError, match=rf"{other}/states\.json.* is 7.*{run}, a run of toy"):
        evaluate_folder(run, truth_folder=other)
    (other / "states.json").unlink()
    with pytest.raises(SequenceError, match=rf"{other} holds no truth to judge {run} by"):
        evaluate_folder(run, truth_folder=other)
    description = yaml.safe_load(case.assembly.read_text())
    description |= {"base": "lid", "parts": {"lid": description["parts"]["plate"]}}
    (case.assembly.parent / "lid.yaml").write_text(yaml.safe_dump(description | {"name": "lids"}))
    lids = load_assembly(case.assembly.parent / "lid.yaml")
    with pytest.raises(RunError, match=rf"{run}: frame 0 .* 'plate', which is no part of lids"):
        evaluate_folder(run, assembly=lids)


def test_what_was_moved_since_the_run_can_be_named(case: Case, tmp_path: Path) -> None:
    moved = replace(case.run, sequence="/gone/scene", assembly="/gone/assembly.yaml", hashes={})
    save_run(moved, case.run_folder)
    with pytest.raises(RunError, match=r"/gone/assembly\.yaml is gone.*--assembly"):
        evaluate_folder(case.run_folder)
    assembly = load_assembly(case.assembly)
    with pytest.raises(SequenceError, match=r"its sequence /gone/scene is no folder.*--truth"):
        evaluate_folder(case.run_folder, assembly=assembly)
    with pytest.raises(SequenceError, match=r"the truth .*nowhere is no folder"):
        evaluate_folder(case.run_folder, assembly=assembly, truth_folder=tmp_path / "nowhere")
    report = evaluate_folder(case.run_folder, assembly=assembly, truth_folder=case.scene)
    assert report["mean"]["add_s_01d"] == 100


def test_visible_shares_are_drawn_by_each_frames_own_camera(case: Case, tmp_path: Path) -> None:
    """As in a scene of crops: the last two frames show what lies 1 m aside, where the plate is then."""
    file = case.scene / "scene_camera.json"
    cameras = json.loads(file.read_text())
    for index in ("1", "2"):
        cameras[index]["cam_K"][2] -= 150.0
    file.write_text(json.dumps(cameras))
    write_truth(tmp_path / "aside", with_visibility=False)
    gt = json.loads((tmp_path / "aside" / "scene_gt.json").read_text())
    for index in ("1", "2"):
        gt[index][0]["cam_t_m2c"][0] = 1000
    (tmp_path / "aside" / "scene_gt.json").write_text(json.dumps(gt))
    report = evaluate_folder(case.run_folder, truth_folder=tmp_path / "aside")
    assert report["parts"]["plate"]["n_visible"] == 3
