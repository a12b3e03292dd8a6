from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Joint, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse, rotation_about, transform_from
from asdfviz.methods.base_votes import BaseVotes
from asdfviz.methods.base_votes_config import BaseVotesConfig
from asdfviz.methods.group_poses import GroupConfig, GroupPoses
from asdfviz.methods.part_poses import part_shapes
from asdfviz.state.relative_pose import RelativePoseConfig

JOINED = np.array([0.05, 0.95])
LOOSE = np.array([0.95, 0.05])
WAY = np.array([0.16, 0.07, 0.0])
"""Far from where the toy's base is, in view."""


def estimate(name: str, T_camera_part: np.ndarray, score: float = 0.7) -> PoseEstimate:
    return PoseEstimate(name, T_camera_part, score, "refined")


def votes_of(assembly: Assembly, config: BaseVotesConfig | None = None) -> BaseVotes:
    shapes = part_shapes(assembly, surface_points=900)
    group = GroupPoses(assembly, shapes, config=GroupConfig())
    return BaseVotes(group, places=RelativePoseConfig(), config=config or BaseVotesConfig())


def away(T_camera_part: Transform) -> Transform:
    return transform_from(np.eye(3), WAY) @ T_camera_part


def follow(votes: BaseVotes, toy, true: Mapping[str, Transform], belief: np.ndarray) -> None:
    """Three frames in which everything is found."""
    for index in range(3):
        poses = {name: estimate(name, T) for name, T in true.items()}
        votes.keep(votes.told(poses, belief, toy.frame(index, true))["base"])


def hidden(toy, true: Mapping[str, Transform]):
    """A board before everything."""
    frame = toy.frame(9, true)
    return replace(frame, depth=np.full_like(frame.depth, 0.3))


@pytest.mark.parametrize("score", [0.2, 0.9])
def test_only_a_sure_pose_takes_the_base_away_from_where_it_is_seen(toy, score: float) -> None:
    true = toy.poses(joined=True)
    votes = votes_of(toy.assembly)
    follow(votes, toy, true, JOINED)
    found = {
        "base": estimate("base", away(true["base"]), score),
        "block": estimate("block", true["block"]),
    }
    told = votes.told(found, JOINED, toy.frame(3, true))["base"]
    assert np.allclose(told.T_camera_part, true["base"])
    assert told.stage == "group"
    assert votes.overruled
    alone = votes.told({"base": found["base"]}, JOINED, toy.frame(4, true))["base"]
    expected = away(true["base"]) if score == 0.9 else true["base"]
    assert np.allclose(alone.T_camera_part, expected)


def test_a_base_that_is_gone_may_be_elsewhere_sooner(toy) -> None:
    """An unsure pose elsewhere counts once depth sees through the place where it was."""
    true = toy.poses(joined=False)
    moved = {**true, "base": away(true["base"])}
    found = {"base": estimate("base", moved["base"], 0.27)}
    for frame, expected in ((toy.frame(3, true), true), (toy.frame(3, moved), moved)):
        votes = votes_of(toy.assembly)
        follow(votes, toy, true, LOOSE)
        told = votes.told(found, LOOSE, frame)["base"].T_camera_part
        assert np.allclose(told, expected["base"])


def test_a_base_that_nothing_shows_is_absent_and_known_again(toy) -> None:
    true = toy.poses(joined=True)
    votes = votes_of(toy.assembly)
    follow(votes, toy, true, JOINED)
    assert votes.told({}, JOINED, hidden(toy, true)) == {}
    assert votes.place is not None
    assert np.allclose(votes.place, true["base"])
    assert votes.hidden is not None
    assert np.allclose(votes.hidden.T_camera_part, true["base"])
    assert not votes.overruled
    votes.keep(None)
    block = {"block": estimate("block", true["block"])}
    told = votes.told(block, JOINED, hidden(toy, true))
    assert np.allclose(told["base"].T_camera_part, true["base"])
    assert told["base"].score == 0.7
    assert told["block"] is block["block"]


def test_a_joined_part_tells_where_a_base_is_that_moved_with_it(toy) -> None:
    """Two of its parts say so; one alone may be in another one's place."""
    parts = toy.assembly.parts
    state = toy.assembly.states[1]
    T_base_pin = transform_from(np.eye(3), np.array([0.0, 0.0, -0.04]))
    joined = replace(state, T_base_part={**state.T_base_part, "pin": T_base_pin})
    assembly = replace(
        toy.assembly,
        parts={name: parts[name] for name in ("base", "block", "pin")},
        states=(toy.assembly.states[0], joined),
    )
    true = toy.poses(joined=True)
    true = {**true, "pin": true["base"] @ T_base_pin}
    moved = {name: away(T) for name, T in true.items()}
    votes = votes_of(assembly)
    follow(votes, toy, true, JOINED)
    both = {name: estimate(name, moved[name]) for name in ("block", "pin")}
    assert "base" not in votes.told({"block": both["block"]}, JOINED, toy.frame(3, moved))
    told = votes.told(both, JOINED, toy.frame(3, moved))["base"]
    assert np.allclose(told.T_camera_part, moved["base"])
    assert told.stage == "group"


def test_a_part_tells_nothing_of_the_base_along_its_joint(toy) -> None:
    """It was pushed on: that the base, which is hidden, went with it is not to be said."""
    along = np.array([0.0, 1.0, 0.0])
    slide = Joint("prismatic", along, np.zeros(3), slide=(-0.03, 0.03))
    joined = replace(toy.assembly.states[1], joints={"block": slide})
    assembly = replace(toy.assembly, states=(toy.assembly.states[0], joined))
    true = toy.poses(joined=True)
    votes = votes_of(assembly)
    follow(votes, toy, true, JOINED)
    T_pushed = transform_from(np.eye(3), 0.025 * along)
    block = true["base"] @ T_pushed @ inverse(true["base"]) @ true["block"]
    found = {"block": estimate("block", block, 0.95)}
    told = votes.told(found, JOINED, hidden(toy, true))["base"]
    assert np.allclose(told.T_camera_part, true["base"])


def test_a_base_that_was_told_turned_otherwise_is_kept_as_it_is(toy) -> None:
    true = toy.poses(joined=True)
    over = transform_from(rotation_about(np.array([0.0, 0, 1]), np.pi), np.zeros(3))
    wrong = {**true, "base": true["base"] @ over}
    votes = votes_of(toy.assembly)
    votes.mended(true["base"])  # nothing was told yet
    assert votes.place is None
    follow(votes, toy, wrong, LOOSE)
    votes.told({"base": estimate("base", wrong["base"])}, LOOSE, toy.frame(3, true))
    votes.mended(true["base"])
    right = estimate("base", true["base"], 0.3)
    assert votes.preferred({"base": right}, None, least=0.2) == {"base": right}
    votes.keep(right)
    told = votes.told({}, LOOSE, toy.frame(4, true))["base"]
    assert np.allclose(told.T_camera_part, true["base"])


def test_two_parts_in_one_place_are_not_both_believed(toy) -> None:
    """What is taken for the base lies where a surer part is."""
    true = toy.poses(joined=False)
    in_block = transform_from(true["base"][:3, :3], true["block"][:3, 3])
    found = {
        "base": estimate("base", in_block, 0.4),
        "block": estimate("block", true["block"], 0.9),
    }
    for shared, expected in ((1.0, in_block), (0.001, true["base"])):
        votes = votes_of(toy.assembly, BaseVotesConfig(shared=shared, leap=0.02))
        follow(votes, toy, true, LOOSE)
        told = votes.told(found, LOOSE, toy.frame(3, true))["base"].T_camera_part
        assert np.allclose(told, expected)


def test_of_poses_near_each_other_the_one_that_depth_agrees_with_is_told(toy) -> None:
    true = toy.poses(joined=True)
    turned = transform_from(rotation_about(np.array([1.0, 0, 0]), 0.4), np.zeros(3))
    found = {
        "base": estimate("base", true["base"] @ turned, 0.25),
        "block": estimate("block", true["block"]),
    }
    votes = votes_of(toy.assembly)
    follow(votes, toy, true, JOINED)
    told = votes.told(found, JOINED, toy.frame(3, true))["base"].T_camera_part
    assert np.allclose(told, true["base"])


@pytest.mark.parametrize("stays", [0.0, 1.0])
def test_a_base_that_something_covers_is_rather_where_it_was(toy, *, stays: float) -> None:
    """Of what covers it a corner looks as if it were the base, a bit nearer."""
    true = toy.poses(joined=True)
    nearer = transform_from(np.eye(3), np.array([0.0, 0.0, -0.02]))
    lifted = {name: nearer @ T for name, T in true.items()}
    cover, board = toy.frame(9, lifted), hidden(toy, true)
    assert cover.depth is not None
    assert board.depth is not None
    v, _ = np.nonzero(cover.depth < cover.depth.max() - 0.01)
    is_corner = (np.arange(len(cover.depth)) < np.quantile(v, 0.08))[:, None]
    frame = replace(cover, depth=np.where(is_corner, cover.depth, board.depth))
    votes = votes_of(toy.assembly, BaseVotesConfig(stays=stays))
    follow(votes, toy, true, JOINED)
    told = votes.told({"block": estimate("block", lifted["block"])}, JOINED, frame)
    place = votes.place
    assert place is not None
    assert np.allclose(place, (true if stays else lifted)["base"]), told


def test_before_any_state_and_when_off_poses_are_as_they_are(toy) -> None:
    true = toy.poses(joined=True)
    found = {name: estimate(name, T, 0.1) for name, T in true.items()}
    votes = votes_of(toy.assembly)
    assert votes.told(found, None, toy.frame(0, true)) == found
    assert votes.may_be is None
    off = votes_of(toy.assembly, BaseVotesConfig(enabled=False))
    follow(off, toy, true, JOINED)
    found = {"base": estimate("base", away(true["base"]), 0.1)}
    assert off.told(found, JOINED, toy.frame(3, true)) == found


@pytest.mark.parametrize("named", ["base", "twin"])
def test_a_base_that_turns_out_to_be_another_part_is_forgotten(toy, named: str) -> None:
    true = toy.poses(joined=True)
    votes = votes_of(toy.assembly)
    follow(votes, toy, true, JOINED)
    votes.rename({"base": named})
    found = {"base": estimate("base", away(true["base"]), 0.2)}
    told = votes.told(found, JOINED, toy.frame(3, true))["base"].T_camera_part
    assert np.allclose(told, true["base"] if named == "base" else away(true["base"]))


def test_the_group_keeps_to_the_base_that_was_told(toy) -> None:
    true = toy.poses(joined=True)
    votes = votes_of(toy.assembly)
    follow(votes, toy, true, JOINED)
    assert votes.may_be is not None
    assert votes.may_be(true["base"])
    assert not votes.may_be(away(true["base"]))


@pytest.mark.parametrize("option", ["leap", "leap_gone", "shared"])
@pytest.mark.parametrize("value", [0.0, 1.1])
def test_options_out_of_range_are_refused(option: str, value: float) -> None:
    with pytest.raises(MethodError, match=rf"base_votes\.{option} is {value:g}"):
        replace(BaseVotesConfig(), **{option: value})


def test_what_is_hidden_counts_for_where_it_was_or_not_at_all() -> None:
    with pytest.raises(MethodError, match=r"base_votes\.stays is -1 and visible 0\.15"):
        BaseVotesConfig(stays=-1.0)


def test_a_base_that_was_never_seen_again_may_still_be_where_it_was(toy) -> None:
    true = toy.poses(joined=True)
    votes = votes_of(toy.assembly, BaseVotesConfig(leap=1.0, leap_gone=1.0))
    follow(votes, toy, true, JOINED)
    block = {"block": estimate("block", true["block"])}
    told = votes.told(block, JOINED, hidden(toy, true))["base"].T_camera_part
    assert np.allclose(told, true["base"])


@pytest.mark.parametrize(
    ("score", "apart", "own"), [(0.9, False, True), (0.9, True, False), (0.3, False, False)]
)
def test_a_settled_base_is_taken_near_its_place_if_it_is_sure(
    toy, score: float, apart: bool, own: bool
) -> None:
    true = toy.poses(joined=True)
    votes = votes_of(toy.assembly)
    follow(votes, toy, true, JOINED)
    told = votes.told({}, JOINED, toy.frame(3, true))["base"]
    T = away(true["base"]) if apart else true["base"]
    settled = {
        "base": estimate("base", T, score),
        "block": estimate("block", true["block"]),
    }
    preferred = votes.preferred(settled, told, least=0.5)
    assert preferred == {**settled, "base": settled["base"] if own else told}
    # Nobody tells where it is: near its place it stays, elsewhere it is absent.
    alone = votes.preferred(settled, None, least=0.5)
    assert alone.keys() == ({"block"} if apart else {"base", "block"})
