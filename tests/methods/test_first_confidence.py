from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate, Stage
from asdfviz.errors import MethodError
from asdfviz.methods.first_confidence import FirstConfidenceConfig, with_confidence
from asdfviz.methods.part_poses import part_shapes

CONFIG = FirstConfidenceConfig()


def scored(toy, pose, *, box_score=0.9, frame=None, config=CONFIG, boxed=True, steady=0):
    true = toy.poses(joined=False)
    shapes = part_shapes(toy.assembly, surface_points=1500)
    box = replace(toy.detection("block", true["block"]), score=box_score)
    frame = toy.frame(1, true) if frame is None else frame
    found = {"block": box} if boxed else {}
    told = with_confidence(
        {"block": pose}, found, shapes, frame, steady={"block": steady}, config=config
    )
    assert told["block"].T_camera_part is pose.T_camera_part
    return told["block"].score


def pose_of(toy, shift=0.0, stage: Stage = "refined", score=0.05):
    T = toy.poses(joined=False)["block"].copy()
    T[0, 3] += shift
    return PoseEstimate("block", T, score, stage)


def test_a_pose_in_its_outline_and_depth_is_surer(toy) -> None:
    right, beside = scored(toy, pose_of(toy)), scored(toy, pose_of(toy, shift=0.04))
    assert right > 0.8 > 0.5 > beside
    # What the box's name alone would have withheld.
    assert scored(toy, pose_of(toy), box_score=0.06) > 0.2


def test_each_witness_counts_for_its_weight(toy) -> None:
    odds = [
        np.log(p / (1 - p))
        for p in (scored(toy, pose_of(toy), box_score=score) for score in (0.2, 0.7))
    ]
    assert odds[1] - odds[0] == pytest.approx(0.5 * CONFIG.detection)
    frame = toy.frame(1, toy.poses(joined=False))
    p = scored(toy, pose_of(toy), frame=replace(frame, depth=None))
    blind = replace(CONFIG, unread=CONFIG.unread - 2.0)
    q = scored(toy, pose_of(toy), frame=replace(frame, depth=None), config=blind)
    assert np.log(p / (1 - p)) - np.log(q / (1 - q)) == pytest.approx(2.0)


def odds_of(p: float) -> float:
    return np.log(p / (1 - p))


def test_what_is_found_where_it_was_is_surer_the_more_so_in_its_outline(toy) -> None:
    unsure = [odds_of(scored(toy, pose_of(toy), box_score=0.1, steady=n)) for n in (0, 4, 8, 40)]
    gains = np.subtract(unsure, unsure[0])
    assert gains[2] == pytest.approx(CONFIG.steady, rel=0.1)
    assert gains[1] == pytest.approx(gains[2] / 2)
    assert gains[3] == gains[2]
    beside = pose_of(toy, shift=0.02)
    gain = odds_of(scored(toy, beside, steady=8)) - odds_of(scored(toy, beside))
    assert 0.2 * gains[2] < gain < 0.8 * gains[2]
    placed = pose_of(toy, stage="group", score=0.3)
    assert scored(toy, placed, steady=8) == scored(toy, placed)


def test_what_a_state_places_is_scored_by_the_group(toy) -> None:
    placed = [scored(toy, pose_of(toy, stage="group", score=s)) for s in (0.0, 0.3, 0.6)]
    assert placed == sorted(placed)
    assert placed[0] == pytest.approx(1 / (1 + np.exp(-CONFIG.placed_bias)))


def test_switched_off_or_without_a_box_the_score_stays(toy) -> None:
    off = FirstConfidenceConfig(enabled=False)
    assert scored(toy, pose_of(toy), config=off) == 0.05
    assert scored(toy, pose_of(toy, stage="group"), config=off) == 0.05
    assert scored(toy, pose_of(toy), boxed=False) == 0.05


def test_no_frames_are_not_long() -> None:
    with pytest.raises(MethodError, match=r"first_confidence\.long"):
        FirstConfidenceConfig(long=0)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_weight_that_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(MethodError, match=r"first_confidence\.outline"):
        FirstConfidenceConfig(outline=value)
