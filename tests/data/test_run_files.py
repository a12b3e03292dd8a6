from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from asdfviz.data.run_files import load_run, save_run
from asdfviz.datatypes import (
    Assembly,
    Detection,
    FramePrediction,
    PoseEstimate,
    Run,
    StateEstimate,
)
from asdfviz.errors import RunError
from asdfviz.geometry.transforms import rotation_about, transform_from


def random_run(frames: int = 3) -> Run:
    rng = np.random.default_rng(5)

    def prediction(index: int) -> FramePrediction:
        T = transform_from(
            rotation_about(rng.normal(size=3), rng.uniform(0, 3)), rng.normal(size=3)
        )
        probabilities = rng.dirichlet(np.ones(3))
        keypoints = rng.normal(size=(17, 2)) * 300
        keypoints[4] = np.nan
        return FramePrediction(
            frame_index=index,
            poses={"jaw": PoseEstimate("jaw", T, float(rng.random()), "refined")},
            state=StateEstimate(
                probabilities, {"appearance": rng.random(3)}, {"group_fit": rng.random(4)}
            ),
            detections=(
                Detection("jaw", rng.random(4) * 700, keypoints, rng.random(17), 0.1 + 0.2),
                Detection("tiny:jaw on", rng.random(4), np.empty((0, 2)), np.empty(0), 0.5),
            ),
            runtime={"detect": 1 / 3, "total": 2 / 3},
        )

    zero = transform_from(rotation_about(np.ones(3), 0.5), np.zeros(3))
    empty = FramePrediction(frame_index=999, poses={}, state=None, not_found={"jaw": zero})
    return Run(
        method="asdf",
        config={"w_P": 0.1, "steps": [1, 2], "weights": None, "name": "ü\u2028<b>"},
        sequence="/data/scene",
        assembly="/models/tiny/assembly.yaml",
        version="0.1.0",
        predictions=(*(prediction(i) for i in range(frames)), empty),
        hashes={"assembly": "ab" * 32},
        initial="first_frame_truth",
        says_states=False,
    )


def assert_equal(a: FramePrediction, b: FramePrediction) -> None:
    assert (a.frame_index, dict(a.runtime)) == (b.frame_index, dict(b.runtime))
    assert list(a.poses) == list(b.poses)
    for name, pose in a.poses.items():
        other = b.poses[name]
        np.testing.assert_array_equal(pose.T_camera_part, other.T_camera_part)
        assert (pose.part, pose.score, pose.stage) == (other.part, other.score, other.stage)
    assert list(a.not_found) == list(b.not_found)
    for name, T in a.not_found.items():
        np.testing.assert_array_equal(T, b.not_found[name])
    assert (a.state is None) == (b.state is None)
    if a.state is not None and b.state is not None:
        np.testing.assert_array_equal(a.state.probabilities, b.state.probabilities)
        assert list(a.state.terms) == list(b.state.terms)
        for name, term in a.state.terms.items():
            np.testing.assert_array_equal(term, b.state.terms[name])
        assert list(a.state.unfolded) == list(b.state.unfolded)
        for name, term in a.state.unfolded.items():
            np.testing.assert_array_equal(term, b.state.unfolded[name])
    assert len(a.detections) == len(b.detections)
    for detection, other in zip(a.detections, b.detections, strict=True):
        assert (detection.label, detection.score) == (other.label, other.score)
        np.testing.assert_array_equal(detection.box_xyxy, other.box_xyxy)
        np.testing.assert_array_equal(detection.keypoints_px, other.keypoints_px)
        np.testing.assert_array_equal(detection.keypoint_scores, other.keypoint_scores)


def test_a_run_reads_back_bit_for_bit(tmp_path: Path, tiny: Assembly) -> None:
    run = random_run()
    save_run(run, tmp_path / "out" / "run")
    read = load_run(tmp_path / "out" / "run", assembly=tiny)
    assert replace(read, predictions=()).config == run.config
    for name in ("method", "sequence", "assembly", "version", "initial", "hashes", "says_states"):
        assert getattr(read, name) == getattr(run, name)
    assert len(read.predictions) == len(run.predictions)
    for a, b in zip(read.predictions, run.predictions, strict=True):
        assert_equal(a, b)
    assert sorted(p.name for p in (tmp_path / "out" / "run").iterdir()) == [
        "predictions.jsonl",
        "run.json",
    ]


def test_a_run_of_an_old_program_may_say_states(tmp_path: Path) -> None:
    save_run(random_run(), tmp_path)
    about = json.loads((tmp_path / "run.json").read_text())
    del about["says_states"]
    (tmp_path / "run.json").write_text(json.dumps(about))
    assert load_run(tmp_path).says_states


def test_a_run_without_frames_reads_back(tmp_path: Path) -> None:
    run = replace(random_run(), predictions=())
    save_run(run, tmp_path)
    assert load_run(tmp_path).predictions == ()


def test_saving_again_replaces_the_run(tmp_path: Path) -> None:
    save_run(random_run(5), tmp_path)
    save_run(random_run(1), tmp_path)
    assert len(load_run(tmp_path).predictions) == 2


@dataclass(frozen=True)
class Config:
    weight: float = 0.25
    weights: Path = Path("/w.safetensors")


def test_config_may_hold_dataclasses_paths_and_numpy_numbers(tmp_path: Path) -> None:
    run = replace(random_run(), config={"a": Config(), "b": np.float64(0.5), "c": (1, 2)})
    save_run(run, tmp_path)
    expected = {"a": {"weight": 0.25, "weights": "/w.safetensors"}, "b": 0.5, "c": [1, 2]}
    assert load_run(tmp_path).config == expected
    with pytest.raises(RunError, match=r"config\.a is a object"):
        save_run(replace(run, config={"a": object()}), tmp_path)


def test_what_is_not_finite_is_not_saved(tmp_path: Path) -> None:
    bad = PoseEstimate("jaw", np.full((4, 4), np.nan), 1.0, "pnp")
    prediction = FramePrediction(frame_index=4, poses={"jaw": bad}, state=None)
    with pytest.raises(RunError, match="frame 4: a pose"):
        save_run(replace(random_run(), predictions=(prediction,)), tmp_path)
    assert not (tmp_path / "run.json").exists()


def about(**fields: object) -> Callable[[Path], object]:
    def damage(folder: Path) -> None:
        content = json.loads((folder / "run.json").read_text())
        (folder / "run.json").write_text(json.dumps({**content, **fields}))

    return damage


def lines(change: Callable[[list[str]], list[str]]) -> Callable[[Path], object]:
    def damage(folder: Path) -> None:
        file = folder / "predictions.jsonl"
        file.write_text("\n".join(change(file.read_text().split("\n"))))

    return damage


def first(**fields: object) -> Callable[[Path], object]:
    return lines(lambda rows: [json.dumps({**json.loads(rows[0]), **fields}), *rows[1:]])


POSE = {"T_camera_part": np.eye(4).tolist(), "score": 1.0, "stage": "pnp"}


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda folder: (folder / "run.json").unlink(), r"it has no run\.json; give a folder"),
        (lambda folder: (folder / "predictions.jsonl").unlink(), r"predictions\.jsonl does not"),
        (lambda folder: (folder / "run.json").write_text('{"format":'), r"not valid JSON"),
        (lambda folder: (folder / "run.json").write_bytes(b"\xff\xfe"), r"cannot be read"),
        (about(format=2), r"has format 2, this program reads 1 to 1; update asdfviz"),
        (about(method=None), r"'method' is missing"),
        (about(sequence="/scenes\0"), r"run\.json holds '/scenes\\x00', which is no text"),
        (about(method="\ud800"), r"run\.json holds '\\ud800', which is no text"),
        (about(config={"\ud800": [1]}), r"which is no text"),
        (about(initial="guess"), r"expected none or first_frame_truth, got 'guess'"),
        (lines(lambda rows: rows[:2]), r"holds 2 frames, but run\.json says 4: it was cut off"),
        (lines(lambda rows: [rows[0], rows[1][:50]]), r"line 2 is not valid JSON"),
        (lines(lambda rows: [rows[0]] * 4), r"holds a frame twice"),
        (first(frame="a"), r"line 1: 'frame': expected a whole number"),
        (first(poses=[]), r"line 1: 'poses': expected an object"),
        (first(poses={"jaw": {**POSE, "stage": "luck"}}), r"expected one of pnp"),
        (first(poses={"jaw": {**POSE, "T_camera_part": [[1]]}}), r"16 finite numbers"),
        (
            first(poses={"jaw": {**POSE, "T_camera_part": (2 * np.eye(4)).tolist()}}),
            r"'jaw' is no rigid transform",
        ),
        (first(poses={"nut": POSE}), r"frame 0 has a pose of 'nut', which is no part of tiny"),
        (
            first(state={"probabilities": [1.0], "terms": {}}),
            r"has 1 state probabilities, but tiny has 3 states",
        ),
        (first(runtime={"total": "fast"}), r"'total': expected a number"),
    ],
)
def test_a_damaged_run_is_refused(
    tmp_path: Path, tiny: Assembly, damage: Callable[[Path], object], message: str
) -> None:
    save_run(random_run(), tmp_path)
    damage(tmp_path)
    with pytest.raises(RunError, match=message):
        load_run(tmp_path, assembly=tiny)
