from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Camera, Frame
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.track.confidence import ConfidenceConfig, Evidence, confidence, depth_gaps
from asdfviz.track.presets import PRESETS
from asdfviz.track.tracker import Body, Tracker

Draw = Callable[[Mapping[str, Body], Mapping[str, Transform], int], Frame]


@pytest.mark.parametrize("mode", ["region", "depth", "icg"])
def test_right_poses_are_told_from_wrong_ones(
    mode: str, box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    tracker = Tracker({"box": box_body}, camera, PRESETS[mode])
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 0)
    tracker.start(frame, {"box": box_poses[0]})
    assert tracker.confidence(frame)["box"] > 0.9
    to_centre = transform_from(np.eye(3), box_body.model.centre)
    # A contour hardly changes with the distance, a surface with a shift along itself.
    axes = {"region": np.eye(3)[:2], "depth": np.eye(3)[2:], "icg": np.eye(3)}[mode]
    for axis in axes:
        shift = transform_from(np.eye(3), 0.04 * axis)
        tracker.replace(frame, {"box": shift @ box_poses[0]})
        assert tracker.confidence(frame)["box"] < 0.5
    turn = transform_from(rotation_about(np.array([0.2, 0.5, 1.0]), 1.2), np.zeros(3))
    wrong = box_poses[0] @ to_centre @ turn @ transform_from(np.eye(3), -box_body.model.centre)
    tracker.replace(frame, {"box": wrong})
    assert tracker.confidence(frame)["box"] < 0.7


def test_what_a_hand_hides_is_left_out(
    box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    tracker = Tracker({"box": box_body}, camera, PRESETS["icg"])
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 0)
    tracker.start(frame, {"box": box_poses[0]})
    open_ = tracker.evidence(frame)["box"]
    assert frame.depth is not None
    rgb, depth = frame.rgb.copy(), frame.depth.copy()
    rgb[:, :140], depth[:, :140] = (205, 160, 135), 0.25
    half = tracker.evidence(replace(frame, rgb=rgb, depth=depth))["box"]
    assert open_.visible > 0.95
    assert 0.2 < half.visible < 0.8
    assert half.fit > 0.95
    assert half.contrast > 0.8 * open_.contrast
    depth[:] = 0.25
    hidden = replace(frame, rgb=rgb, depth=depth)
    gap = tracker.evidence(hidden)["box"].gap
    assert gap is not None
    assert gap < -0.1, "what hides it is nearer"
    assert tracker.evidence(hidden)["box"] == Evidence(0.0, 0.0, 0.0, measured=False, gap=gap)
    assert tracker.confidence(hidden)["box"] == 0.0


def test_confidence_grows_with_each_piece_of_evidence() -> None:
    config = ConfidenceConfig()
    poor = confidence(Evidence(0.3, 0.1, 1.0), config, has_color=True, has_depth=True)
    for better in (Evidence(0.6, 0.1, 1.0), Evidence(0.3, 0.9, 1.0)):
        assert confidence(better, config, has_color=True, has_depth=True) > poor
    # What lies flat fits the table by depth alone, which says nothing.
    flat = confidence(Evidence(0.0, 0.9, 1.0), config, has_color=True, has_depth=True)
    assert flat < config.lost_below
    full = Evidence(1.0, 1.0, 1.0)
    assert confidence(full, config, has_color=True, has_depth=True) > 0.98
    for seen, share in ((0.075, 0.5), (0.0, 0.0)):
        scarce = confidence(full._replace(visible=seen), config, has_color=True, has_depth=True)
        assert scarce == pytest.approx(share, abs=0.015)
    # Without a single reading the colours alone are asked, as in a frame without depth.
    unmeasured = Evidence(0.9, 0.0, 1.0, 0.9, measured=False)
    assert confidence(unmeasured, config, has_color=True, has_depth=True) > 0.9
    measured = unmeasured._replace(measured=True)
    assert confidence(measured, config, has_color=True, has_depth=True) < config.lost_below
    assert confidence(full, config, has_color=True, has_depth=False) > 0.99
    assert confidence(full, config, has_color=False, has_depth=True) > 0.99


def test_gaps_are_how_far_the_measured_surface_lies_behind() -> None:
    wall = np.full((120, 160), 0.5, np.float32)
    wall[:, :80] = 0.0  # a hole
    lens = np.array([150.0, 150.0, 79.5, 59.5])
    points = np.array([[-0.02, 0.0, 0.0], [0.02, 0.0, 0.0], [0.03, 0.01, 0.01], [5.0, 0.0, 0.0]])
    T = transform_from(np.eye(3), np.array([0.0, 0.0, 0.48]))
    gaps = depth_gaps(wall, points, len(points), T, lens)
    np.testing.assert_allclose(gaps, [0.02, 0.01], atol=1e-6)
