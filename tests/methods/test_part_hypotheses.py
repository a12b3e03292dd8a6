from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.kept_poses import HypothesesConfig, Proposal
from asdfviz.methods.part_hypotheses import PartHypotheses
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.registration import RegistrationConfig


@pytest.fixture
def kept(toy) -> PartHypotheses:
    return PartHypotheses(
        toy.assembly.parts["block"],
        part_shapes(toy.assembly, surface_points=900)["block"],
        config=HypothesesConfig(),
        registration=RegistrationConfig(),
    )


def tilted(T_camera_part: np.ndarray, degrees: float) -> np.ndarray:
    turn = rotation_about(np.array([1.0, 0.0, 0.0]), np.radians(degrees))
    return T_camera_part @ transform_from(turn, np.zeros(3))


def is_at(decision, T_camera_part: np.ndarray) -> bool:
    return decision is not None and np.allclose(
        decision.best.T_camera_part, T_camera_part, atol=0.004
    )


def test_a_wrong_first_pose_is_outlived_by_what_agrees_longer(toy, kept) -> None:
    true = toy.poses(joined=False)
    right, wrong = true["block"], tilted(true["block"], 45)
    box = toy.detection("block", right).box_xyxy
    frame = toy.frame(1, true)
    both = [Proposal(right, 0.9, is_fitted=True), Proposal(wrong, 1.0, is_fitted=True)]
    first = kept.step(both, frame, box_xyxy=box)
    assert first is not None
    assert is_at(first, right)
    assert first.lead > 0
    later = first
    for _ in range(3):
        # The network now says the wrong one alone; depth has the last word.
        later = kept.step([Proposal(wrong, 1.0, is_fitted=True)], frame, box_xyxy=box)
        assert is_at(later, right)
    assert later is not None
    assert later.best.frames == 4


def test_a_covered_part_keeps_its_pose_and_a_moved_one_does_not(toy, kept) -> None:
    true = toy.poses(joined=False)
    right = true["block"]
    box = toy.detection("block", right).box_xyxy
    seen = toy.frame(1, true)
    before = None
    for _ in range(4):
        before = kept.step([Proposal(right, 1.0, is_fitted=True)], seen, box_xyxy=box)
    hand = toy.frame(2, true)
    assert hand.depth is not None
    x0, y0, x1, y1 = box.astype(int)
    hand.depth[y0 - 3 : y1 + 4, x0 - 3 : x1 + 4] = 0.3
    covered = kept.step([Proposal(tilted(right, 60), 1.0, is_fitted=True)], hand, box_xyxy=box)
    assert is_at(covered, right)
    assert before is not None
    assert covered is not None
    assert covered.best.trust > 0.9 * before.best.trust  # nothing was seen that speaks against it
    away = right.copy()
    away[0, 3] += 0.12
    moved = toy.frame(3, {**true, "block": away})
    there = toy.detection("block", away).box_xyxy
    after = None
    for _ in range(2):
        after = kept.step([Proposal(away, 1.0, is_fitted=True)], moved, box_xyxy=there)
    assert is_at(after, away)


def test_a_covered_part_is_there_again_whatever_was_taken_for_it_meanwhile(toy, kept) -> None:
    true = toy.poses(joined=False)
    right, other = true["block"], true["block"].copy()
    other[0, 3] += 0.12
    box, elsewhere = (toy.detection("block", T).box_xyxy for T in (right, other))
    seen = toy.frame(1, true)
    for _ in range(8):
        kept.step([Proposal(right, 1.0, is_fitted=True)], seen, box_xyxy=box)
    uncovered = toy.frame(2, {**true, "block": other})
    assert uncovered.depth is not None
    uncovered.depth[:] = np.minimum(uncovered.depth, toy.depth({"block": right}))
    hand = replace(uncovered, depth=uncovered.depth.copy())
    assert hand.depth is not None
    x0, y0, x1, y1 = box.astype(int)
    hand.depth[y0 - 3 : y1 + 4, x0 - 3 : x1 + 4] = 0.3
    taken = kept.step([], hand, box_xyxy=elsewhere)
    assert is_at(taken, other)
    found = [kept.step([], uncovered, box_xyxy=box) for _ in range(3)]
    assert is_at(found[-1], right)


def test_without_a_box_depth_alone_must_show_it(toy, kept) -> None:
    true = toy.poses(joined=False)
    frame = toy.frame(1, true)
    assert kept.step([], frame, box_xyxy=None) is None
    box = toy.detection("block", true["block"]).box_xyxy
    kept.step([Proposal(true["block"], 1.0, is_fitted=True)], frame, box_xyxy=box)
    assert is_at(kept.step([], frame, box_xyxy=None), true["block"])
    gone = toy.frame(2, {"base": true["base"]})
    assert kept.step([], gone, box_xyxy=None) is None


def test_without_depth_the_first_proposal_is_the_answer(toy, kept) -> None:
    T_camera_part = toy.poses(joined=False)["block"]
    box = toy.detection("block", T_camera_part).box_xyxy
    proposals = [Proposal(T_camera_part, 1.0), Proposal(np.eye(4), 0.2)]
    found = kept.step(proposals, toy.frame(1), box_xyxy=box)
    assert found is not None
    assert found.best.T_camera_part is T_camera_part


def test_where_depth_is_blind_the_first_proposal_is_the_answer(toy, kept) -> None:
    """What was kept is kept for later: it says nothing of a place that depth does not see."""
    true = toy.poses(joined=False)
    right = true["block"]
    away = right.copy()
    away[0, 3] += 0.12
    box, there = (toy.detection("block", T).box_xyxy for T in (right, away))
    seen = toy.frame(1, true)
    measured = kept.step([Proposal(right, 1.0, is_fitted=True)], seen, box_xyxy=box)
    assert measured.is_measured
    blind = toy.frame(2, {**true, "block": away})
    blind.depth[:, int((box[2] + there[0]) / 2) :] = 0.0
    told = kept.step([Proposal(away, 1.0)], blind, box_xyxy=there)
    assert is_at(told, away)
    assert not told.is_measured
    assert kept.step([], blind, box_xyxy=there) is None
    assert is_at(kept.step([Proposal(right, 1.0, is_fitted=True)], seen, box_xyxy=box), right)


def test_of_two_that_depth_cannot_tell_apart_the_network_decides_in_time(toy, kept) -> None:
    """A box turned round looks the same to depth; one frame's opinion does not turn it back."""
    true = toy.poses(joined=False)
    right = true["block"]
    turned = right @ transform_from(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    box = toy.detection("block", right).box_xyxy
    frame = toy.frame(1, true)

    def step(first, second, *, likes_right: float):
        likely = {right.tobytes(): likes_right, turned.tobytes(): 1 - likes_right}
        return kept.step(
            [Proposal(first, 1.0, is_fitted=True), Proposal(second, 0.5, is_fitted=True)],
            frame,
            box_xyxy=box,
            likely=lambda T: likely[T.tobytes()],
        )

    assert is_at(step(turned, right, likes_right=0.2), turned)
    decided = [step(right, turned, likes_right=0.9) for _ in range(5)][-1]
    assert is_at(decided, right)
    assert is_at(step(turned, right, likes_right=0.1), right)
    assert decided is not None
    # A frame in which the network says nothing changes nothing.
    liked = decided.best.liked
    after = kept.step([], frame, box_xyxy=None)
    assert after is not None
    assert after.best.liked == pytest.approx(liked, abs=0.2)


def rested(toy, kept: PartHypotheses, *, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """A block that was looked at in so many frames; its pose and its box."""
    true = toy.poses(joined=False)
    box = toy.detection("block", true["block"]).box_xyxy
    look = [Proposal(true["block"], 1.0, is_fitted=True)]
    for index in range(frames):
        kept.step(look, toy.frame(index, true), box_xyxy=box)
    return true["block"], box


def test_a_part_that_lies_still_is_looked_at_now_and_then(toy, kept) -> None:
    every = HypothesesConfig().looked_every
    T, box = rested(toy, kept, frames=every + 2)
    true, asked = toy.poses(joined=False), list[bool]()
    for index in range(100, 100 + 3 * every):
        frame = toy.frame(index, true)
        rests = kept.rests(box, frame)
        asked.append(rests is None)
        wrong = Proposal(tilted(T, 90), 1.0, is_fitted=True)
        # What rests takes no proposals; what does not is confirmed.
        look = [Proposal(T, 1.0, is_fitted=True)] if rests is None else [wrong]
        decision = kept.step(look, frame, box_xyxy=box)
        assert is_at(decision, T)
        assert decision is not None
        assert decision.best.frames == every + 3 + index - 100
    assert sum(asked) == 3


def test_what_moved_or_is_not_known_well_does_not_rest(toy, kept) -> None:
    T, box = rested(toy, kept, frames=2)
    assert kept.rests(box, toy.frame(50, toy.poses(joined=False))) is None
    T, box = rested(toy, kept, frames=HypothesesConfig().looked_every + 2)
    away = T.copy()
    away[0, 3] += 0.12
    gone = toy.frame(51, {**toy.poses(joined=False), "block": away})
    assert kept.rests(box, gone) is None  # depth sees through it
    still = toy.frame(52, toy.poses(joined=False))
    assert kept.rests(box + 9.0, still) is None
    assert kept.rests(box + 1.0, still) is not None
    assert kept.rests(box, replace(still, depth=None)) is None


def test_an_option_out_of_range_is_named() -> None:
    with pytest.raises(MethodError, match="looked_every 0"):
        HypothesesConfig(looked_every=0)
