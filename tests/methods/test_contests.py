"""Two things look like the block; it is the one on which the block's pose agrees with outline and depth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Detection, Frame
from asdfviz.detector.crop_answer import CropAnswer
from asdfviz.detector.crop_cut import crop_camera
from asdfviz.errors import MethodError
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.methods.contests import Contests, ContestsConfig
from asdfviz.methods.looked_at import LookedAt
from asdfviz.pose.hypotheses import Settled


@pytest.fixture
def frame(toy: Any) -> Frame:
    return toy.frame(0, {})


def answered(detection: Detection) -> CropAnswer:
    one = np.array([[1.0, 0, 0, 0]])
    return CropAnswer(
        camera=crop_camera(detection.box_xyxy, np.diag([300.0, 300.0, 1.0])),
        rotations=one,
        probabilities=np.array([0.5]),
        grid=one,
        distribution=np.ones(1),
        place=np.zeros(3),
        outline=np.ones((24, 24)),
        states=np.zeros(0),
    )


class Agreeing:
    """Says how well a pose agrees by where the box begins; counts how often it was asked."""

    def __init__(self, by_x: Mapping[int, float]) -> None:
        self.by_x = dict(by_x)
        self.asked = 0
        self.last: list[str] = []

    def __call__(self, boxes: Mapping[str, Detection], frame: Frame) -> dict[str, LookedAt]:
        self.asked += len(boxes)
        self.last = list(boxes)
        found = {name: self.by_x.get(int(d.box_xyxy[0])) for name, d in boxes.items()}
        return {
            name: LookedAt(
                (Settled(np.eye(4), value, refined=True),),
                answered(boxes[name]),
                boxes[name],
                Symmetries(),
            )
            for name, value in found.items()
            if value is not None
        }


def contests(assembly: Assembly, look: Agreeing, **options: Any) -> Contests:
    return Contests(assembly, look, ContestsConfig(**options))


def test_a_pose_that_agrees_outdoes_a_somewhat_better_score(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    like, block = box_at("block", 120, score=0.8), box_at("block", 20, score=0.6)
    look = Agreeing({120: 0.5, 20: 0.7})
    decided = contests(assembly, look).step({"block": like}, [like, block], frame)
    assert decided["block"].box_xyxy[0] == 20
    assert look.asked == 2
    even = contests(assembly, Agreeing({120: 0.7, 20: 0.7}))
    assert even.step({"block": like}, [like, block], frame)["block"] is like


def test_what_has_no_pose_counts_as_a_poor_one(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    like, block = box_at("block", 120, score=0.8), box_at("block", 20, score=0.5)
    decided = contests(assembly, Agreeing({20: 0.6})).step({"block": like}, [like, block], frame)
    assert decided["block"].box_xyxy[0] == 20
    decided = contests(assembly, Agreeing({20: 0.3})).step({"block": like}, [like, block], frame)
    assert decided["block"] is like


def test_a_thing_that_looks_far_less_like_it_is_not_even_asked(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    block, other = box_at("block", 20, score=0.8), box_at("block", 120, score=0.3)
    look = Agreeing({120: 0.9, 20: 0.1})
    decided = contests(assembly, look).step({"block": block}, [block, other], frame)
    assert decided == {"block": block}
    assert look.asked == 0


def test_another_parts_box_does_not_contest(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    block = box_at("block", 20, score=0.5)
    pin = replace(box_at("pin", 120, score=0.6), class_scores={"block": 0.5})
    look = Agreeing({120: 0.9, 20: 0.1})
    found = {"block": block, "pin": pin}
    assert contests(assembly, look).step(found, [block, pin], frame) == found
    assert look.asked == 0
    alone = contests(assembly, look).step({"block": block}, [block, pin], frame)["block"]
    assert (alone.label, alone.score, alone.box_xyxy[0]) == ("block", 0.5, 120)


def test_a_thing_that_lies_still_is_judged_over_time(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    like, block = box_at("block", 120, score=0.7), box_at("block", 20, score=0.7)
    look = Agreeing({120: 0.5, 20: 0.7})
    contest = contests(assembly, look, every=4)
    for _ in range(10):
        decided = contest.step({"block": like}, [like, block], frame)
        assert decided["block"].box_xyxy[0] == 20
    assert look.asked == 2 * 4, "twice at first, then every fourth frame"
    look.by_x = {120: 0.75, 20: 0.7}  # one frame deceives
    for _ in range(4):
        decided = contest.step({"block": like}, [like, block], frame)
        assert decided["block"].box_xyxy[0] == 20


def test_a_look_past_a_hand_does_not_decide(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    like, block = box_at("block", 120, score=0.7), box_at("block", 20, score=0.7)
    look = Agreeing({120: 0.6, 20: 0.4})
    judged = contests(assembly, look, every=1)
    for seen in (0.4, 0.7, 0.7):  # the first time something was in front of it
        look.by_x[20] = seen
        decided = judged.step({"block": like}, [like, block], frame)
    assert decided["block"].box_xyxy[0] == 20


def test_what_was_seen_long_ago_does_not_count(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    like, block = box_at("block", 120, score=0.7), box_at("block", 20, score=0.7)
    look = Agreeing({120: 0.8, 20: 0.4})
    contest = contests(assembly, look, every=4)
    assert contest.step({"block": like}, [like, block], frame)["block"] is like
    for _ in range(9):
        contest.step({}, [], frame)
    look.by_x = {120: 0.6, 20: 0.7}
    assert contest.step({"block": like}, [like, block], frame)["block"].box_xyxy[0] == 20


def test_what_lost_is_not_the_part_while_that_is_hidden(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    like, block = box_at("block", 120, score=0.7), box_at("block", 20, score=0.7)
    contest = contests(assembly, Agreeing({120: 0.5, 20: 0.7}), forgotten=30)
    for _ in range(3):
        contest.step({"block": block}, [like, block], frame)
    sways = [box_at("block", 120, 10 * k, score=0.7) for k in range(1, 4)]
    for alone in sways:
        assert contest.step({"block": alone}, [alone], frame) == {}
    carried = box_at("block", 180, score=0.7)
    assert contest.step({"block": carried}, [carried], frame) == {"block": carried}
    for _ in range(31):
        contest.step({}, [], frame)
    assert contest.step({"block": sways[-1]}, [sways[-1]], frame) == {"block": sways[-1]}


def test_what_lost_is_looked_at_again_in_the_order_in_which_it_was_found(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    names, block = [f"part {k}" for k in range(8)], assembly.parts["block"]
    parts = {name: replace(block, name=name, detector_class=name) for name in names}
    look = Agreeing({120: 0.5, 20: 0.7})
    contest = contests(replace(assembly, parts=parts), look, every=1)
    likes = {name: box_at(name, 120, 50 * k) for k, name in enumerate(names)}
    right = [box_at(name, 20, 50 * k) for k, name in enumerate(names)]
    for _ in range(3):
        contest.step(likes, [*likes.values(), *right], frame)
    assert contest.step(likes, [*likes.values()], frame) == {}
    assert look.last == names


def test_what_lost_while_half_hidden_is_the_part_once_it_fits_better(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    hand, block = box_at("block", 120, score=0.3), box_at("block", 20, score=0.2)
    look = Agreeing({120: 0.5, 20: 0.4})
    contest = contests(assembly, look, every=4)
    for _ in range(3):
        decided = contest.step({"block": block}, [hand, block], frame)
        assert decided["block"].box_xyxy[0] == 120
    assert contest.step({"block": block}, [block], frame) == {}
    look.by_x = {20: 0.8}
    shown = box_at("block", 20, score=0.8)
    answers = [contest.step({"block": shown}, [shown], frame) for _ in range(12)]
    assert answers[-1] == {"block": shown}
    assert answers[0] == {}, "one frame deceives"


def test_without_depth_or_switched_off_the_best_box_stays(
    assembly: Assembly, box_at: Callable, frame: Frame
) -> None:
    like, block = box_at("block", 120, score=0.8), box_at("block", 20, score=0.7)
    look = Agreeing({120: 0.2, 20: 0.9})
    blind = replace(frame, depth=None)
    assert contests(assembly, look).step({"block": like}, [like, block], blind)["block"] is like
    off = contests(assembly, look, enabled=False)
    assert off.step({"block": like}, [like, block], frame)["block"] is like
    assert look.asked == 0


def test_options_out_of_range_are_refused() -> None:
    with pytest.raises(MethodError, match=r"contests\.close is 0"):
        ContestsConfig(close=0.0)
