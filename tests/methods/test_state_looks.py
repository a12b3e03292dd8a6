"""S_DL from a crop about the base part, with a looker that says what it is told to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.datatypes import PoseEstimate
from asdfviz.detector.crop_answer import CropAnswer
from asdfviz.detector.crop_classes import crop_classes, group_box, group_name, group_radius
from asdfviz.detector.crop_cut import CONTEXT, crop_camera
from asdfviz.detector.network import Network
from asdfviz.detector.state_network import StateNetwork
from asdfviz.detector.state_weights import save_state_network
from asdfviz.detector.weights import save_network
from asdfviz.errors import MethodError, WeightsError
from asdfviz.geometry.camera import project
from asdfviz.geometry.rotation_grid import even_rotations
from asdfviz.geometry.transforms import apply, transform_from
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.first_pose import CropPoseConfig, CropPoses
from asdfviz.methods.network import NetworkConfig
from asdfviz.methods.state_looks import CropStates, GroupLooker, KeptLooks, StateLooks
from asdfviz.pose.hypotheses import HypothesisConfig
from asdfviz.state.appearance import AppearanceConfig

GROUP = "toy//group"


@dataclass
class FakeLooker:
    """Knows the states in another order than the assembly, and one more."""

    told: tuple[float, ...] = (0.2, 0.7, 0.1)
    classes: tuple[str, ...] = (GROUP, "toy/base")
    states: dict[str, tuple[str, ...]] = field(
        default_factory=lambda: {GROUP: ("other", "block", "base")}
    )
    boxes: list[np.ndarray] = field(default_factory=list)

    def look(self, rgb, K, boxes) -> Mapping[str, CropAnswer]:
        answers: dict[str, CropAnswer] = {}
        for name, (label, box) in boxes.items():
            if label == GROUP:
                self.boxes.append(box)
                told = np.array(self.told)
            else:
                told = np.zeros(0)
            rotations, shown = even_rotations(4), np.full((24, 24), 0.9)
            camera = crop_camera(box, K)
            even = np.full(4, 0.25)
            answers[name] = CropAnswer(
                camera=camera,
                rotations=rotations,
                probabilities=even,
                grid=rotations,
                distribution=even,
                place=np.zeros(3),
                outline=shown,
                states=told,
            )
        return answers


def looks(toy, looker: FakeLooker, chosen=None, detector=None) -> StateLooks:
    poses = CropPoses.of(toy.assembly, looker, config=HypothesisConfig())
    return StateLooks.of(
        toy.assembly,
        config=AppearanceConfig(),
        chosen=chosen,
        detector=detector or NetworkConfig(),
        crops=CropPoseConfig(),
        crop_poses=poses,
    )


def base_pose(toy) -> dict[str, PoseEstimate]:
    T = toy.poses(joined=True)["base"]
    return {"base": PoseEstimate("base", T, 0.9, "crop")}


def test_states_are_told_by_name_and_only_those_of_the_assembly(toy) -> None:
    looker = FakeLooker()
    told = looks(toy, looker).probabilities((), base_pose(toy), toy.frame(0))
    assert told == pytest.approx(np.array([0.1, 0.7]) / 0.8)


def test_errors_are_rarer_than_in_training(toy) -> None:
    wrong = replace(toy.assembly.states[1], is_error=True, after=0)
    assembly = replace(toy.assembly, states=(toy.assembly.states[0], wrong))
    even = FakeLooker(told=(0.0, 0.5, 0.5))
    looker = CropStates(even, group_radius(assembly))
    group = GroupLooker.of(assembly, looker, config=AppearanceConfig(error_odds=0.25))
    assert group is not None
    assert group.look(base_pose(toy), toy.frame(0)) == pytest.approx([0.8, 0.2])


def test_the_crop_is_cut_about_the_base_wide_enough_for_most_of_the_group(toy) -> None:
    looker = FakeLooker()
    frame, poses = toy.frame(0), toy.poses(joined=True)
    looks(toy, looker).probabilities((), base_pose(toy), frame)
    low, high = looker.boxes[0][:2], looker.boxes[0][2:]
    middle = apply(poses["base"], crop_classes([toy.assembly])[-1].middle[None])
    assert (low + high) / 2 == pytest.approx(project(middle, frame.camera.K)[0], abs=1e-6)
    vertices = np.concatenate(
        [apply(poses[n], toy.assembly.parts[n].mesh.vertices) for n in ("base", "block")]
    )
    seen = project(vertices, frame.camera.K)
    margin = (CONTEXT - 1) / 2 * (high - low)
    shown = np.all((seen > low - margin) & (seen < high + margin), axis=1)
    assert shown.mean() > 0.75


def test_the_groups_box_does_not_depend_on_how_the_base_is_turned(toy) -> None:
    K, radius = toy.frame(0).camera.K, group_radius(toy.assembly)
    middle = crop_classes([toy.assembly])[-1].middle
    upright = transform_from(np.eye(3), np.array([0.05, 0.0, 0.7]) - middle)
    R = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
    turned = transform_from(R, np.array([0.05, 0.0, 0.7]) - R @ middle)
    box = group_box(toy.assembly, radius, upright, K)
    assert box == pytest.approx(group_box(toy.assembly, radius, turned, K))
    assert box[2] - box[0] == pytest.approx(2 * K[0, 0] * radius / 0.7)


def test_boxes_speak_where_there_is_no_base(toy) -> None:
    looker = FakeLooker()
    chosen = looks(toy, looker)
    assert chosen.probabilities((), {}, toy.frame(0)) is None
    told = chosen.probabilities((toy.state_box(0.9),), {}, toy.frame(0))
    assert told is not None
    assert told[1] > 0.9
    behind = transform_from(np.eye(3), np.array([3.0, 0, 0.7]))  # far out of view
    poses = {"base": PoseEstimate("base", behind, 0.9, "crop")}
    assert chosen.probabilities((), poses, toy.frame(0)) is None
    assert looker.boxes == []


def test_boxes_can_be_chosen_and_are_the_default_of_keypoints(toy) -> None:
    assert looks(toy, FakeLooker(), "boxes").group is None
    with_keypoints = StateLooks.of(
        toy.assembly,
        config=AppearanceConfig(),
        chosen=None,
        detector=NetworkConfig(),
        crops=CropPoseConfig(),
        crop_poses=None,
    )
    assert with_keypoints.group is None


def _write_detector(file: Path, classes: tuple[str, ...]) -> None:
    file.parent.mkdir(exist_ok=True)
    save_network(Network("n", classes=len(classes)), file, classes=classes, image_size=640)


def test_a_detector_of_the_assembly_alone_keeps_its_boxes(toy, tmp_path) -> None:
    toy = replace(toy, assembly=replace(toy.assembly, path=str(tmp_path / "assembly.yaml")))
    assert looks(toy, FakeLooker()).group is not None
    _write_detector(tmp_path / "weights.safetensors", ("base", "block"))
    assert looks(toy, FakeLooker()).group is None
    assert looks(toy, FakeLooker(), "crops").group is not None
    other = tmp_path / "other" / "weights.safetensors"
    _write_detector(other, ("base", "block"))
    assert looks(toy, FakeLooker(), detector=NetworkConfig(weights=other)).group is not None


def test_a_copy_of_a_detector_of_several_assemblies_is_nobodys_own(toy, tmp_path) -> None:
    toy = replace(toy, assembly=replace(toy.assembly, path=str(tmp_path / "assembly.yaml")))
    _write_detector(tmp_path / "weights.safetensors", ("toy/base", "toy/block", "other/base"))
    assert looks(toy, FakeLooker()).group is not None
    _write_detector(tmp_path / "weights.safetensors", ("toy/base", "toy/block"))
    assert looks(toy, FakeLooker()).group is None


def test_a_network_that_does_not_know_every_state_leaves_it_to_the_boxes(toy) -> None:
    looker = FakeLooker(states={GROUP: ("base", "other")})
    assert looks(toy, looker).group is None
    with pytest.raises(WeightsError, match=r"it has base, other; the assembly has base, block"):
        looks(toy, looker, "crops")


def _write_states(file: Path, *states: str) -> None:
    network = StateNetwork(
        points=0.02 * torch.randn(1, 16, 3),
        normals=torch.ones(1, 16, 3),
        axes=torch.tensor([[1.0, 0.0, 0.0]]),
        states=len(states),
    )
    save_state_network(network, file, states={GROUP: states})


def test_a_state_network_that_knows_the_states_is_asked_first(toy, tmp_path) -> None:
    toy = replace(toy, assembly=replace(toy.assembly, path=str(tmp_path / "assembly.yaml")))
    _write_states(tmp_path / "states.safetensors", "block", "base", "other")
    _write_detector(tmp_path / "weights.safetensors", ("base", "block"))
    looker = FakeLooker()
    told = looks(toy, looker).probabilities((), base_pose(toy), toy.frame(0))
    assert told is not None
    assert told.shape == (2,)
    assert told.sum() == pytest.approx(1)
    assert looker.boxes == []
    assert looks(toy, looker, "boxes").group is None
    looks(toy, looker, "crops").probabilities((), base_pose(toy), toy.frame(0))
    assert len(looker.boxes) == 1
    _write_states(tmp_path / "states.safetensors", "block", "other")
    assert looks(toy, looker).group is None  # so the assembly's own detector speaks
    with pytest.raises(WeightsError, match=r"state network does not know all states.*train-states"):
        looks(toy, looker, "places")


def test_a_state_network_that_is_broken_says_so(toy, tmp_path) -> None:
    toy = replace(toy, assembly=replace(toy.assembly, path=str(tmp_path / "assembly.yaml")))
    with pytest.raises(WeightsError, match="no state weights"):
        looks(toy, FakeLooker(), "places")
    (tmp_path / "states.safetensors").write_bytes(b"nothing of the kind")
    with pytest.raises(WeightsError, match="not a whole safetensors file"):
        looks(toy, FakeLooker())
    crops = CropPoseConfig(state_weights=tmp_path / "other.safetensors")
    _write_states(tmp_path / "other.safetensors", "base", "block")
    chosen = StateLooks.of(
        toy.assembly,
        config=AppearanceConfig(),
        chosen="places",
        detector=NetworkConfig(),
        crops=crops,
        crop_poses=None,
    )
    assert chosen.probabilities((), base_pose(toy), toy.frame(0)) is not None
    assert chosen.probabilities((), {}, toy.frame(0)) is None


def test_asdf_says_what_the_crop_says(toy, detector) -> None:
    poses = toy.poses(joined=True)
    detector.answers[1] = (toy.detection("base", poses["base"]),)
    for told, state in (((0.0, 0.99, 0.01), "block"), ((0.0, 0.01, 0.99), "base")):
        method = Asdf(AsdfConfig(), detector=detector, looker=FakeLooker(told=told))
        method.reset(toy.assembly, toy.frame(0).camera, None)
        said = method.step(toy.frame(1)).state
        assert said is not None
        assert toy.assembly.states[int(said.terms["appearance"].argmax())].name == state


def test_groups_have_names_that_no_part_has(toy) -> None:
    names = [c.name for c in crop_classes([toy.assembly])]
    assert names[-1] == group_name(toy.assembly) == GROUP
    assert len(set(names)) == len(names) == 4


def test_looks_are_kept_for_the_frames_between(toy) -> None:
    looker = FakeLooker()
    kept = KeptLooks(looks(toy, looker), every=2)
    told = [kept.step((), base_pose(toy), toy.frame(1))]
    looker.told = (0.2, 0.1, 0.7)
    told += [kept.step((), base_pose(toy), toy.frame(index)) for index in (2, 3)]
    assert len(looker.boxes) == 2
    first, kept_on, again = told
    assert first is not None
    assert kept_on is not None
    assert again is not None
    assert np.array_equal(first, kept_on)
    assert not np.allclose(kept_on, again)


def test_looks_are_not_kept_without_the_base(toy) -> None:
    kept = KeptLooks(looks(toy, FakeLooker()), every=2)
    assert kept.step((), base_pose(toy), toy.frame(1)) is not None
    assert kept.step((), {}, toy.frame(2)) is None


def test_every_has_to_be_a_number_of_frames() -> None:
    with pytest.raises(MethodError, match="looks_every is 0"):
        AsdfConfig(looks_every=0)
