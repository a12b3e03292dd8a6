from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Camera, Frame
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Transform
from asdfviz.track.bodies import Body
from asdfviz.track.presets import FINE, PRESETS
from asdfviz.track.surface_colors import SurfaceColorsConfig
from asdfviz.track.tracker import Tracker

Draw = Callable[[Mapping[str, Body], Mapping[str, Transform], int], Frame]
_RED = np.array([200, 60, 30], np.uint8)


def _colored(body: Body, color: np.ndarray) -> Body:
    return replace(body, color=color.astype(np.uint8))


@pytest.fixture
def tracker(box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw) -> Tracker:
    """Has followed a resting box for three frames."""
    tracker = Tracker({"box": box_body}, camera, FINE)
    tracker.start(draw({"box": box_body}, {"box": box_poses[0]}, 0), {"box": box_poses[0]})
    for index in range(1, 4):
        tracker.update(draw({"box": box_body}, {"box": box_poses[0]}, index))
    return tracker


def test_another_thing_of_that_shape_is_not_the_part_though_its_colors_are_learnt(
    tracker: Tracker, box_body: Body, box_poses: list[Transform], draw: Draw
) -> None:
    right = draw({"box": box_body}, {"box": box_poses[0]}, 4)
    assert tracker.confidence(right)["box"] > 0.9
    blue = _colored(box_body, np.array([40, 60, 190]))
    for index in range(5, 40):
        tracker.update(draw({"box": blue}, {"box": box_poses[0]}, index))
    other = draw({"box": blue}, {"box": box_poses[0]}, 40)
    seen = tracker.evidence(other)["box"]
    assert seen.contrast > 0.8  # the contour's histograms know no other colour by now
    assert seen.fit > 0.9
    assert seen.alike is not None
    assert seen.alike < 0.1
    assert tracker.confidence(other)["box"] < 0.6
    assert tracker.confidence(right)["box"] > tracker.confidence(other)["box"]


def test_light_that_changes_slowly_is_followed(
    tracker: Tracker, box_body: Body, box_poses: list[Transform], draw: Draw
) -> None:
    frames = [
        draw({"box": _colored(box_body, _RED * (1 - 0.006 * i))}, {"box": box_poses[0]}, 5 + i)
        for i in range(60)
    ]
    for frame in frames:
        tracker.update(frame)
    seen = tracker.evidence(frames[-1])["box"]
    assert seen.alike is not None
    assert seen.alike > 0.8


def test_one_frame_tells_nothing_of_itself(
    box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 0)
    tracker = Tracker({"box": box_body}, camera, FINE)
    tracker.start(frame, {"box": box_poses[0]})
    assert tracker.evidence(frame)["box"].alike is None
    tracker.learn(frame, ["box"])
    alike = tracker.evidence(frame)["box"].alike
    assert alike == pytest.approx(1.0)


def test_a_corner_of_a_surface_is_like_the_whole_of_it(
    tracker: Tracker, box_poses: list[Transform], box_body: Body, draw: Draw
) -> None:
    """Each half has a colour of its own, and the box is begun with both in sight."""
    frames = [draw({"box": box_body}, {"box": box_poses[0]}, i) for i in range(10, 13)]
    for frame in frames:
        frame.rgb[:, 160:] = frame.rgb[:, 160:] // 4  # the right half lies in a shadow
    tracker.start(frames[0], {"box": box_poses[0]})
    tracker.update(frames[1])
    depth = frames[2].depth
    assert depth is not None
    depth = depth.copy()
    depth[:, 150:] = 0.25  # a hand before all of that, and a little of the other half
    half = tracker.evidence(replace(frames[2], depth=depth))["box"]
    assert half.visible < 0.7
    assert half.alike is not None
    assert half.alike > 0.8


def test_what_cannot_be_seen_is_like_nothing(
    tracker: Tracker, box_poses: list[Transform], box_body: Body, draw: Draw
) -> None:
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 9)
    assert frame.depth is not None
    hand = replace(frame, depth=np.full_like(frame.depth, 0.25))
    assert tracker.evidence(hand)["box"].alike is None


def test_depth_alone_knows_no_colors(
    box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    tracker = Tracker({"box": box_body}, camera, PRESETS["depth"])
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 0)
    tracker.start(frame, {"box": box_poses[0]})
    tracker.learn(frame, ["box"])
    assert tracker.evidence(frame)["box"].alike is None


@pytest.mark.parametrize("choose", [True, False])
def test_colors_choose_between_trials_only_where_they_may(
    choose: bool, box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    config = replace(FINE, colors=SurfaceColorsConfig(choose=choose))
    tracker = Tracker({"box": box_body}, camera, config)
    tracker.start(draw({"box": box_body}, {"box": box_poses[0]}, 0), {"box": box_poses[0]})
    tracker.update(draw({"box": box_body}, {"box": box_poses[0]}, 1))
    blue = _colored(box_body, np.array([40, 60, 190]))
    other = draw({"box": blue}, {"box": box_poses[0]}, 2)
    (trial,) = tracker.trials(other, "box", [box_poses[0]])
    assert (trial.evidence.alike is not None) == choose
    assert trial.confidence < 0.2  # they judge it in any case


def test_forgotten_colors_are_learnt_anew(
    tracker: Tracker, box_body: Body, box_poses: list[Transform], draw: Draw
) -> None:
    blue = _colored(box_body, np.array([40, 60, 190]))
    frame = draw({"box": blue}, {"box": box_poses[0]}, 7)
    before = tracker.evidence(frame)["box"].alike
    tracker.forget_colors("box")
    assert before is not None
    assert before < 0.1
    assert tracker.evidence(frame)["box"].alike is None
    tracker.learn(frame, ["box"])
    assert tracker.evidence(frame)["box"].alike == pytest.approx(1.0)


def test_colors_are_begun_anew_at_the_pose_that_a_part_has(
    tracker: Tracker, box_body: Body, box_poses: list[Transform], draw: Draw
) -> None:
    blue = _colored(box_body, np.array([40, 60, 190]))
    frames = [draw({"box": blue}, {"box": box_poses[0]}, index) for index in (7, 8)]
    T_before = tracker.poses["box"]
    assert tracker.confidence(frames[0])["box"] < 0.2
    tracker.begin_colors(frames[0], "box")
    tracker.learn(frames[0], ["box"])
    assert tracker.confidence(frames[1])["box"] > 0.9
    np.testing.assert_array_equal(tracker.poses["box"], T_before)
    with pytest.raises(InputError, match="'lid' is not tracked"):
        tracker.begin_colors(frames[0], "lid")
