"""Runners-up of poses from keypoints of flat parts."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate
from asdfviz.geometry.transforms import inverse, rotation_about, rotation_angle, transform_from
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.flat_twins import flat_twin
from asdfviz.methods.kept_poses import HypothesesConfig
from asdfviz.methods.part_hypotheses import PartHypotheses
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.registration import RegistrationConfig
from asdfviz.pose.pnp import ROBUST_PNP, PnpConfig, mirrored_twin

FAR = np.array([0.0, 0.0, 1.4])
TILTED = transform_from(rotation_about(np.array([1.0, 0.3, 0]), 0.5), FAR)
"""A plate, seen from far: hardly any perspective."""


def mirrored(toy, T: np.ndarray) -> np.ndarray:
    keypoints = toy.assembly.parts["base"].keypoints
    return mirrored_twin(T, keypoints.mean(axis=0), np.array([0.0, 0.0, 1.0]))


def own(T: np.ndarray, name: str = "base") -> PoseEstimate:
    return PoseEstimate(name, T, 0.7, "refined")


def test_the_twin_of_a_plate_turns_back_to_the_plate(toy) -> None:
    plate = toy.assembly.parts["base"]
    wrong = mirrored(toy, TILTED)
    assert np.rad2deg(rotation_angle(wrong[:3, :3].T @ TILTED[:3, :3])) > 40
    detection = toy.detection("base", TILTED, noise_px=0.3)
    twin = flat_twin(own(wrong), plate, detection, toy.frame(1), config=ROBUST_PNP)
    assert twin is not None
    turned = inverse(twin.T_camera_part)[:3, :3] @ TILTED[:3, :3]
    assert np.rad2deg(rotation_angle(turned)) < 6
    assert twin.likely > 0.8


def test_a_block_has_none(toy) -> None:
    T = transform_from(TILTED[:3, :3], FAR / 4)
    detection = toy.detection("block", T, noise_px=0.5)
    assert (
        flat_twin(
            own(T, "block"), toy.assembly.parts["block"], detection, toy.frame(1), config=ROBUST_PNP
        )
        is None
    )


@pytest.mark.parametrize("kept", [True, False])
def test_depth_tells_the_plate_from_its_twin(toy, detector, *, kept: bool) -> None:
    """PnP took the wrong one of two minima; over a few frames depth puts that right."""
    config = AsdfConfig(pnp=PnpConfig(mirrored=kept), first_pose="keypoints")
    near = transform_from(TILTED[:3, :3], FAR / 2)
    asdf = Asdf(config, detector=detector)
    asdf.reset(toy.assembly, toy.frame(0).camera, None)
    asdf.assigned = {"base": toy.detection("base", near, noise_px=0.3)}
    shape = part_shapes(toy.assembly, surface_points=900)["base"]
    hypotheses = PartHypotheses(
        toy.assembly.parts["base"],
        shape,
        config=HypothesesConfig(),
        registration=RegistrationConfig(enabled=False),
    )
    decision = None
    for index in range(4):
        frame = toy.frame(index, {"base": near})
        proposals = asdf.proposals(own(mirrored(toy, near)), frame)
        assert len(proposals) == (2 if kept else 1)
        box = asdf.assigned["base"].box_xyxy
        decision = hypotheses.step(proposals, frame, box_xyxy=box)
    assert decision is not None
    turned = decision.best.T_camera_part[:3, :3].T @ near[:3, :3]
    assert (np.rad2deg(rotation_angle(turned)) < 12) == kept
