from __future__ import annotations

import dataclasses
from collections.abc import Sequence as Listing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from asdfviz import __version__
from asdfviz.datatypes import (
    Assembly,
    Camera,
    Frame,
    FramePrediction,
    FrameTruth,
    Mesh,
    Part,
    PoseEstimate,
    Run,
    State,
    StateEstimate,
)
from asdfviz.detector.state_network import StateNetwork
from asdfviz.detector.state_weights import save_state_network
from asdfviz.errors import MethodError, SequenceError, WeightsError
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.registry import find_method
from asdfviz.methods.spec import MethodSpec
from asdfviz.run import input_hashes, resolved_config, run

PLUGIN = """
from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from asdfviz.datatypes import FramePrediction, PoseEstimate, StateEstimate
from asdfviz.methods.network import NetworkConfig
from asdfviz.methods.spec import MethodSpec

GIVEN = []


@dataclass(frozen=True)
class Config:
    fault: str = ""
    detector: NetworkConfig = field(default_factory=NetworkConfig)


class Mine:
    def __init__(self, config: Config) -> None:
        self.config = config

    def reset(self, assembly, camera, initial) -> None:
        GIVEN.append(initial)
        if self.config.fault == "reset":
            raise RuntimeError("no start today")

    def step(self, frame) -> FramePrediction:
        fault = self.config.fault
        if fault == "step" and frame.index == 12:
            raise ValueError("twelve is too much")
        if fault == "exit":
            raise SystemExit(7)
        if fault == "none":
            return None
        time.sleep(0.002)
        pose = PoseEstimate("base", np.eye(4) * (2.0 if fault == "rigid" else 1.0), 0.9, "pnp")
        poses = {"bose" if fault == "part" else "base": pose}
        state = StateEstimate(np.full(2 if fault == "state" else 3, 1 / 3))
        index = frame.index + (fault == "index")
        return FramePrediction(index, poses, state, (), {"think": 0.001})


SPEC = MethodSpec("mine", "Says base.", Config, f"{__name__}:Mine", initial="INITIAL")
"""


@dataclass
class ToySequence:
    """Four frames numbered 10 to 13, the first with truth, none with depth."""

    path: str
    assembly: Assembly | None
    name: str = "toy"
    has_truth: bool = True
    truth_asked: Listing[int] = ()
    missing_assembly: str | None = None

    camera: Camera = field(default_factory=lambda: Camera(np.eye(3), 8, 6))
    frame_indices: tuple[int, ...] = (10, 11, 12, 13)

    def __len__(self) -> int:
        return len(self.frame_indices)

    def __getitem__(self, place: int) -> Frame:
        rgb = np.zeros((6, 8, 3), dtype=np.uint8)
        return Frame(self.frame_indices[place], 0.1 * place, rgb, None, self.camera)

    def truth(self, place: int) -> FrameTruth | None:
        self.truth_asked = (*self.truth_asked, place)
        if not self.has_truth:
            return None
        poses = {"base": np.eye(4), "stranger": np.eye(4)}
        return FrameTruth(self.frame_indices[place], poses, 0, is_error=True, attached=("base",))


@pytest.fixture
def assembly(tmp_path: Path) -> Assembly:
    file = tmp_path / "models" / "assembly.yaml"
    file.parent.mkdir()
    file.write_text("name: toy\n")
    corners = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0.1, 0]])
    part = Part(
        "base",
        Mesh(corners, np.array([[0, 1, 2]], dtype=np.int32)),
        np.tile(corners, (6, 1))[:17],
        Symmetries(),
        0.14,
        np.zeros(3, dtype=np.uint8),
        "base",
    )
    joined = {"base": np.eye(4)}
    states = (
        State(0, "base", joined),
        State(1, "done", joined, detector_class="toy:done"),
        State(2, "wrong", joined, is_error=True, after=0),
    )
    transitions = frozenset({(0, 1), (0, 2)})
    return Assembly("toy", "Toy", "base", {"base": part}, states, transitions, ("base",), str(file))


@pytest.fixture
def sequence(tmp_path: Path, assembly: Assembly) -> ToySequence:
    folder = tmp_path / "scene"
    for name, content in (
        ("rgb/000010.png", "a"),
        ("depth/000010.png", "b"),
        ("camera.json", "{}"),
    ):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(content)
    return ToySequence(str(folder), assembly)


@pytest.fixture
def spec(tmp_path: Path) -> MethodSpec:
    return load(tmp_path, "none")


def load(folder: Path, initial: str) -> MethodSpec:
    file = folder / f"{initial}.py"
    file.write_text(PLUGIN.replace("INITIAL", initial))
    return find_method(f"{file}:SPEC")


def given(spec: MethodSpec) -> list[FramePrediction | None]:
    import importlib

    return importlib.import_module(spec.factory.partition(":")[0]).GIVEN


def faulty(spec: MethodSpec, fault: str) -> Any:
    return spec.config(fault=fault)


def test_every_frame_is_stepped_and_timed(spec: MethodSpec, sequence: ToySequence) -> None:
    result = run(spec, sequence)
    assert [p.frame_index for p in result.predictions] == [10, 11, 12, 13]
    for prediction in result.predictions:
        assert prediction.runtime["think"] == 0.001
        assert 0.002 <= prediction.runtime["total"] < 5.0
    assert result.method == "mine"
    assert result.version == __version__
    assert result.initial == "none"
    assert result.says_states
    poses_alone = dataclasses.replace(spec, predicts=frozenset({"pose"}))
    assert not run(poses_alone, sequence).says_states


def test_the_run_names_its_inputs_in_full(
    spec: MethodSpec, sequence: ToySequence, assembly: Assembly
) -> None:
    result = run(spec, sequence, config=faulty(spec, ""))
    assert result.sequence == sequence.path
    assert result.assembly == assembly.path
    expected = {"weights": Path(assembly.path).parent / "weights.safetensors", "image_size": 640}
    detector = result.config["detector"]
    assert isinstance(detector, dict)
    assert expected.items() <= detector.items()
    assert result.config["fault"] == ""


def test_hashes_follow_the_content(
    spec: MethodSpec, sequence: ToySequence, assembly: Assembly
) -> None:
    before = run(spec, sequence).hashes
    assert set(before) == {"assembly", "sequence"}
    assert run(spec, sequence).hashes == before
    Path(sequence.path, "notes.txt").write_text("results beside the images do not count")
    assert run(spec, sequence).hashes == before
    Path(assembly.path).with_name("weights.safetensors").write_bytes(b"weights")
    Path(sequence.path, "rgb/000010.png").write_text("A")
    part = assembly.parts["base"]
    bigger = Mesh(part.mesh.vertices * 2, part.mesh.faces)
    sequence.assembly = dataclasses.replace(
        assembly, parts={"base": dataclasses.replace(part, mesh=bigger)}
    )
    after = run(spec, sequence).hashes
    assert set(after) == {"assembly", "sequence", "weights"}
    assert after["assembly"] != before["assembly"]
    assert after["sequence"] != before["sequence"]


def test_crop_weights_are_named_where_first_poses_come_from_them(
    sequence: ToySequence, assembly: Assembly
) -> None:
    weights = Path(assembly.path).with_name("crops.safetensors")
    assert resolved_config(AsdfConfig(), assembly).first_pose == "keypoints"
    weights.write_bytes(b"one")
    used = resolved_config(AsdfConfig(), assembly)
    assert (used.first_pose, used.crops.weights) == ("hypotheses", weights.resolve())
    before = input_hashes(sequence, assembly, AsdfConfig())["crops"]
    weights.write_bytes(b"two")
    assert input_hashes(sequence, assembly, AsdfConfig())["crops"] != before
    assert "crops" not in input_hashes(sequence, assembly, AsdfConfig(first_pose="keypoints"))


def test_the_state_network_is_named_where_it_is_asked(
    sequence: ToySequence, assembly: Assembly
) -> None:
    folder = Path(assembly.path).parent
    (folder / "crops.safetensors").write_bytes(b"one")
    assert resolved_config(AsdfConfig(), assembly).state_looks is None
    nowhere = torch.zeros(1, 4, 3)
    known = {f"{assembly.name}//group": [s.name for s in assembly.states]}
    network = StateNetwork(
        points=nowhere,
        normals=nowhere.clone(),
        axes=nowhere[:, 0].clone(),
        states=len(assembly.states),
    )
    weights = folder / "states.safetensors"
    save_state_network(network, weights, states=known)
    used = resolved_config(AsdfConfig(), assembly)
    assert (used.state_looks, used.crops.state_weights) == ("places", weights.resolve())
    assert "states" in input_hashes(sequence, assembly, AsdfConfig())
    for asks in (AsdfPlusConfig(), AsdfTrackConfig()):
        assert resolved_config(asks, assembly).crops.state_weights == weights.resolve()
    others = (
        AsdfConfig(state_looks="crops"),
        AsdfConfig(first_pose="keypoints"),
        AsdfPlusConfig(state_looks="crops"),
        AsdfTrackConfig(state_looks="boxes"),
    )
    for config in others:
        assert "states" not in input_hashes(sequence, assembly, config)
        assert resolved_config(config, assembly).state_looks == config.state_looks


def test_progress_is_told_after_every_frame(spec: MethodSpec, sequence: ToySequence) -> None:
    told: list[tuple[int, int, int]] = []
    run(
        spec,
        sequence,
        progress=lambda done, total, said: told.append((done, total, said.frame_index)),
    )
    assert told == [(1, 4, 10), (2, 4, 11), (3, 4, 12), (4, 4, 13)]


def test_a_stopped_run_keeps_what_was_done(spec: MethodSpec, sequence: ToySequence) -> None:
    done: list[int] = []
    result = run(
        spec,
        sequence,
        progress=lambda count, *_: done.append(count),
        stop=lambda: len(done) == 2,
    )
    assert [p.frame_index for p in result.predictions] == [10, 11]
    assert run(spec, sequence, stop=lambda: True).predictions == ()


def test_views_of_the_parts_are_made_before_the_first_frame(
    spec: MethodSpec, sequence: ToySequence, assembly: Assembly
) -> None:
    assert assembly.parts["base"].mesh.faces.shape == (1, 3)
    tracks = dataclasses.replace(spec, viewpoints=True)
    told: list[tuple[int, int]] = []

    def stop() -> bool:
        return len(told) > 1

    assert run(tracks, sequence, prepare=lambda *k: told.append(k), stop=stop).predictions == ()
    assert told[0][0] < told[0][1]
    told.clear()
    run(spec, sequence, prepare=lambda *k: told.append(k))
    assert told == []


@pytest.mark.parametrize(("fault", "kept"), [("step", [10, 11]), ("none", [])])
def test_a_failed_run_keeps_what_was_done(
    spec: MethodSpec, sequence: ToySequence, fault: str, kept: list[int]
) -> None:
    found: list[Run] = []
    with pytest.raises(MethodError):
        run(spec, sequence, config=faulty(spec, fault), keep=found.append)
    assert [p.frame_index for so_far in found for p in so_far.predictions] == kept
    assert all(set(so_far.hashes) == {"assembly", "sequence"} for so_far in found)


def test_an_interrupted_run_keeps_what_was_done(spec: MethodSpec, sequence: ToySequence) -> None:
    found: list[Run] = []

    def interrupt(done: int, *_: object) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(spec, sequence, progress=interrupt, keep=found.append)
    assert [len(so_far.predictions) for so_far in found] == [3]


def test_truth_is_never_touched_unless_asked_for(spec: MethodSpec, sequence: ToySequence) -> None:
    run(spec, sequence)
    assert sequence.truth_asked == ()
    assert given(spec)[-1] is None


def test_a_method_that_asks_gets_the_first_frame_alone(
    tmp_path: Path, sequence: ToySequence
) -> None:
    spec = load(tmp_path, "first_frame_truth")
    result = run(spec, sequence)
    assert result.initial == "first_frame_truth"
    assert sequence.truth_asked == (0,)
    initial = given(spec)[-1]
    assert initial is not None
    assert initial.frame_index == 10
    assert set(initial.poses) == {"base"}
    assert initial.poses["base"].stage == "truth"
    assert initial.state is not None
    assert initial.state.index == 2  # the error that follows state 0


def test_no_truth_where_it_is_needed_is_an_error(tmp_path: Path, sequence: ToySequence) -> None:
    sequence.has_truth = False
    with pytest.raises(SequenceError, match="no truth"):
        run(load(tmp_path, "first_frame_truth"), sequence)


def test_a_sequence_without_an_assembly_asks_for_it(
    spec: MethodSpec, sequence: ToySequence
) -> None:
    sequence.assembly = None
    with pytest.raises(SequenceError, match="--assembly"):
        run(spec, sequence)


def test_an_assembly_that_is_named_but_not_there_is_said(
    spec: MethodSpec, sequence: ToySequence
) -> None:
    sequence.assembly = None
    sequence.missing_assembly = "my_clamp"
    with pytest.raises(
        SequenceError, match=r"names the assembly 'my_clamp', not found.*--assembly"
    ):
        run(spec, sequence)


def test_an_empty_sequence_is_an_error(spec: MethodSpec, sequence: ToySequence) -> None:
    sequence.frame_indices = ()
    with pytest.raises(SequenceError, match="no frames"):
        run(spec, sequence)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("reset", "'mine' failed to start: RuntimeError: no start today"),
        ("step", "frame 12: ValueError: twelve is too much"),
        ("part", "frame 10: no part 'bose'.*parts: base"),
        ("rigid", "frame 10: the pose of 'base' is not a rigid transform"),
        ("state", "2 state probabilities, toy has 3 states"),
        ("exit", "frame 10: SystemExit: 7"),
        ("none", r"frame 10: step\(\) returned None, expected a FramePrediction"),
        ("index", "frame 10: it answered for frame 11"),
    ],
)
def test_a_method_that_fails_is_named_with_the_frame(
    spec: MethodSpec, sequence: ToySequence, fault: str, message: str
) -> None:
    with pytest.raises(MethodError, match=message):
        run(spec, sequence, config=faulty(spec, fault))


def test_an_error_of_ours_passes_through(sequence: ToySequence) -> None:
    with pytest.raises(WeightsError, match="asdfviz train"):
        run(find_method("asdf"), sequence)


def test_a_run_can_be_saved_and_read_back(
    spec: MethodSpec, sequence: ToySequence, tmp_path: Path
) -> None:
    run_files = pytest.importorskip("asdfviz.data.run_files")
    result = run(spec, sequence)
    run_files.save_run(result, tmp_path / "out")
    again = run_files.load_run(tmp_path / "out")
    assert [p.frame_index for p in again.predictions] == [10, 11, 12, 13]
    pose = again.predictions[0].poses["base"]
    assert isinstance(pose, PoseEstimate)
    assert (pose.T_camera_part == np.eye(4)).all()
    state = again.predictions[0].state
    assert isinstance(state, StateEstimate)
    assert dict(again.hashes) == dict(result.hashes)
