from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Frame, Joint, PoseEstimate, StateEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.group_poses import GroupConfig, GroupPoses
from asdfviz.methods.part_poses import part_shapes


def estimate(name: str, T_camera_part: np.ndarray) -> PoseEstimate:
    return PoseEstimate(name, T_camera_part, 0.7, "refined")


def group_of(toy, config: GroupConfig) -> GroupPoses:
    shapes = part_shapes(toy.assembly, surface_points=900)
    return GroupPoses(toy.assembly, shapes, config=config)


@pytest.fixture
def group(toy) -> GroupPoses:
    return group_of(toy, GroupConfig())


def careful(toy) -> GroupPoses:
    """Settled by hardly any state."""
    return group_of(toy, GroupConfig(settled=0.95))


SURE = StateEstimate(np.array([0.05, 0.95]))
OPEN = StateEstimate(np.array([0.45, 0.55]))


def test_a_joined_part_that_was_not_found_is_placed(toy, group) -> None:
    true = toy.poses(joined=True)
    frame = toy.frame(1, true)
    found = group.step({"base": estimate("base", true["base"])}, SURE, frame)
    assert found["block"].stage == "group"
    assert np.allclose(found["block"].T_camera_part, true["block"])
    assert found["base"].stage == "refined"
    assert 0 < found["block"].score < 0.7
    assert set(found) == {"base", "block"}


def test_the_base_is_placed_by_its_joined_part(toy, group) -> None:
    true = toy.poses(joined=True)
    found = group.step({"block": estimate("block", true["block"])}, SURE, toy.frame(1, true))
    assert np.allclose(found["base"].T_camera_part, true["base"])


def test_an_uncertain_state_places_nothing(toy, group) -> None:
    true = toy.poses(joined=True)
    poses = {"base": estimate("base", true["base"])}
    for state in (OPEN, None):
        assert set(group.step(poses, state, toy.frame(1, true))) == {"base"}


def test_where_depth_shows_nothing_of_it_the_part_stays_absent(toy, group) -> None:
    true = toy.poses(joined=True)
    frame = toy.frame(1, {"base": true["base"]})
    assert set(group.step({"base": estimate("base", true["base"])}, SURE, frame)) == {"base"}


def test_a_wrong_pose_yields_and_a_right_one_stays(toy, group) -> None:
    true = toy.poses(joined=True)
    frame = toy.frame(1, true)
    off = true["block"] @ transform_from(np.eye(3), np.array([0.0, 0.05, 0.0]))
    wrong = {"base": estimate("base", true["base"]), "block": estimate("block", off)}
    found = group.step(wrong, SURE, frame)
    assert found["block"].stage == "group"
    assert np.allclose(found["block"].T_camera_part, true["block"])
    right = {name: estimate(name, T) for name, T in true.items()}
    kept = group.step(right, SURE, frame)
    assert {pose.stage for pose in kept.values()} == {"refined"}


def behind_board(toy, true: Mapping[str, np.ndarray], name: str = "block") -> Frame:
    """A board before one part, with the other one in view beside it."""
    board = toy.depth({name: true[name]}) < 0.74
    frame = toy.frame(1, true)
    return replace(frame, depth=np.where(board, np.float32(0.3), frame.depth))


@pytest.mark.parametrize("hidden", [0.4, 0.0])
def test_what_hides_a_place_does_not_speak_against_it(toy, hidden: float) -> None:
    true = toy.poses(joined=True)
    base = {"base": estimate("base", true["base"])}
    found = group_of(toy, GroupConfig(hidden=hidden)).step(base, SURE, behind_board(toy, true))
    assert ("block" in found) == (hidden > 0)
    if hidden > 0:
        assert np.allclose(found["block"].T_camera_part, true["block"])


@pytest.mark.parametrize("hidden", [0.4, 0.0])
def test_a_hidden_base_is_where_others_tell_it_to_be(toy, hidden: float) -> None:
    true = toy.poses(joined=True)
    block = {"block": estimate("block", true["block"])}
    found = group_of(toy, GroupConfig(hidden=hidden)).step(
        block, SURE, behind_board(toy, true, "base")
    )
    assert ("base" in found) == (hidden > 0)
    if hidden > 0:
        assert np.allclose(found["base"].T_camera_part, true["base"])


@pytest.mark.parametrize("has_twin", [True, False])
def test_a_hidden_part_is_where_it_is_joined_whatever_like_it_is_found_elsewhere(
    toy, *, has_twin: bool
) -> None:
    true, apart = toy.poses(joined=True), toy.poses(joined=False)
    assembly = toy.assembly
    if has_twin:
        twin = replace(assembly.parts["block"], name="twin")
        assembly = replace(assembly, parts={**assembly.parts, "twin": twin})
    group = GroupPoses(assembly, part_shapes(assembly, surface_points=900), config=GroupConfig())
    poses = {"base": estimate("base", true["base"]), "block": estimate("block", apart["block"])}
    found = group.step(poses, SURE, behind_board(toy, true))
    assert np.allclose(found["block"].T_camera_part, true["block"])
    assert set(found) == {"base", "block", *(["twin"] if has_twin else [])}
    if has_twin:  # which is what lies there, and is called so
        assert np.allclose(found["twin"].T_camera_part, apart["block"])
        assert found["twin"].part == "twin"


def test_the_surest_of_like_parts_are_the_loose_ones(toy) -> None:
    """Two things look like the loose twin, and the joined one is hidden."""
    true, apart = toy.poses(joined=True), toy.poses(joined=False)
    twin = replace(toy.assembly.parts["block"], name="twin")
    assembly = replace(toy.assembly, parts={**toy.assembly.parts, "twin": twin})
    shapes = part_shapes(assembly, surface_points=900)
    group = GroupPoses(assembly, shapes, config=GroupConfig())
    other = apart["block"] @ transform_from(np.eye(3), np.array([0.1, 0.0, 0.0]))
    poses = {
        "base": estimate("base", true["base"]),
        "block": estimate("block", apart["block"]),
        "twin": replace(estimate("twin", other), score=0.3),
    }
    found = group.step(poses, SURE, behind_board(toy, true))
    assert np.allclose(found["twin"].T_camera_part, apart["block"])
    assert np.allclose(found["block"].T_camera_part, true["block"])
    assert (found["twin"].stage, found["block"].stage) == ("refined", "group")


def test_where_the_state_is_settled_a_pose_elsewhere_is_not_believed(toy) -> None:
    """Something like the block lies apart, and depth agrees with it there even better."""
    group = careful(toy)
    joined, apart = toy.poses(joined=True), toy.poses(joined=False)
    depth = np.minimum(toy.depth(joined), toy.depth({"block": apart["block"]}))
    rows, columns = np.nonzero(toy.depth({"block": joined["block"]}) < 0.74)
    left = columns < np.quantile(columns, 0.4)
    depth[rows[left], columns[left]] = 0.75
    frame = replace(toy.frame(1, joined), depth=depth)
    poses = {"base": estimate("base", joined["base"]), "block": estimate("block", apart["block"])}
    likely = StateEstimate(np.array([0.1, 0.9]))
    assert group.step(poses, likely, frame)["block"].stage == "refined"
    settled = StateEstimate(np.array([0.01, 0.99]))
    found = group.step(poses, settled, frame)["block"]
    assert found.stage == "group"
    assert np.allclose(found.T_camera_part, joined["block"])


def test_not_even_a_much_surer_pose_elsewhere_is_believed_then(toy) -> None:
    group = careful(toy)
    joined, apart = toy.poses(joined=True), toy.poses(joined=False)
    depth = np.minimum(toy.depth(joined), toy.depth({"block": apart["block"]}))
    frame = replace(toy.frame(1, joined), depth=depth)
    poses = {"base": estimate("base", joined["base"]), "block": estimate("block", apart["block"])}
    poses = {n: replace(p, score={"base": 0.6, "block": 0.92}[n]) for n, p in poses.items()}
    likely = StateEstimate(np.array([0.1, 0.9]))
    assert group.step(poses, likely, frame)["block"].stage == "refined"
    settled = StateEstimate(np.array([0.01, 0.99]))
    assert group.step(poses, settled, frame)["block"].stage == "group"


def test_the_base_is_where_the_whole_group_says(toy, group) -> None:
    true = toy.poses(joined=True)
    off = transform_from(np.eye(3), np.array([0.03, 0.02, 0.0])) @ true["base"]
    poses = {"base": replace(estimate("base", off), score=0.4)}
    seen = PoseEstimate("base", true["base"], 0.9, "group")
    found = group.step(poses, SURE, toy.frame(1, true), base=seen)
    assert np.allclose(found["base"].T_camera_part, true["base"])
    assert np.allclose(found["block"].T_camera_part, true["block"])


def test_trying_a_place_of_the_base_leaves_no_trace(toy, group) -> None:
    """What a candidate of the base would make of a joint is not remembered unless it is taken."""
    slide = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), slide=(-0.03, 0.03))
    states = (toy.assembly.states[0], replace(toy.assembly.states[1], joints={"block": slide}))
    assembly = replace(toy.assembly, states=states)
    shapes = part_shapes(assembly, surface_points=900)
    true = toy.poses(joined=True)
    T_block = true["block"] @ transform_from(np.eye(3), np.array([0.012, 0.0, 0.0]))
    slid = {"base": true["base"], "block": T_block}
    group = GroupPoses(assembly, shapes, config=GroupConfig())
    poses = {name: estimate(name, T) for name, T in slid.items()}
    group.step(poses, SURE, toy.frame(1, slid))
    found = group.step({"base": poses["base"]}, SURE, toy.frame(2, slid))
    assert np.allclose(found["block"].T_camera_part, T_block, atol=1e-6)


@pytest.mark.parametrize("twin", [True, False])
def test_a_loose_twin_that_goes_by_the_joined_ones_name_does_not_tell_where_the_base_is(
    toy, *, twin: bool
) -> None:
    """A board hides the group; the pin is followed behind it, and a block that lies apart is sure."""
    parts = {name: part for name, part in toy.assembly.parts.items() if name != "pin-copy"}
    state = toy.assembly.states[1]
    T_base_pin = transform_from(np.eye(3), np.array([0.0, 0.0, -0.04]))
    joined = replace(state, T_base_part={**state.T_base_part, "pin": T_base_pin})
    copy = {"block-Copy": replace(parts["block"], name="block-Copy")} if twin else {}
    assembly = replace(
        toy.assembly, parts={**parts, **copy}, states=(toy.assembly.states[0], joined)
    )
    group = GroupPoses(
        assembly, part_shapes(assembly, surface_points=900), config=GroupConfig(least_fit=0.0)
    )
    T_camera_base, apart = toy.poses(joined=True)["base"], toy.poses(joined=False)["block"]
    poses = {
        "block": replace(estimate("block", apart), score=0.98),
        "pin": estimate("pin", T_camera_base @ T_base_pin),
    }
    frame = replace(toy.frame(1, {}), depth=np.full_like(toy.frame(1, {}).depth, 0.3))
    base = group.step(poses, SURE, frame)["base"].T_camera_part
    wrong = apart @ np.linalg.inv(state.T_base_part["block"])
    assert np.allclose(base, T_camera_base if twin else wrong)


def test_a_base_far_from_where_it_may_be_is_not_taken(toy, group) -> None:
    """A sure block elsewhere would take the base with it."""
    true = toy.poses(joined=True)
    frame = toy.frame(1, true)
    poses = {
        "base": estimate("base", true["base"]),
        "block": replace(estimate("block", toy.poses(joined=False)["block"]), score=0.99),
    }
    asked = list[np.ndarray]()

    def may_be(T_camera_base: np.ndarray) -> bool:
        asked.append(T_camera_base)
        return np.allclose(T_camera_base, true["base"])

    found = group.step(poses, StateEstimate(np.array([0.01, 0.99])), frame, may_be=may_be)
    assert len(asked) == 2
    assert np.allclose(found["base"].T_camera_part, true["base"])
    assert np.allclose(found["block"].T_camera_part, true["block"])


@pytest.mark.parametrize("score", [0.5, 0.15])
def test_an_unsure_pose_in_its_place_yields_to_a_sure_group(toy, group, score: float) -> None:
    """Though depth agrees a little better with its own, which is 4 mm beside."""
    true = toy.poses(joined=True)
    off = true["block"] @ transform_from(np.eye(3), np.array([0.0, 0.004, 0.0]))
    poses = {
        "base": estimate("base", true["base"]),
        "block": replace(estimate("block", off), score=score),
    }
    frame = toy.frame(1, {**true, "block": off})
    found = group.step(poses, StateEstimate(np.array([0.01, 0.99])), frame)["block"]
    assert found.stage == ("refined" if score == 0.5 else "group")


@pytest.mark.parametrize("name", ["certain", "settled", "least_fit", "hidden"])
def test_shares_out_of_range_are_refused(name: str) -> None:
    with pytest.raises(MethodError, match=f"group.{name} is 1.5, use 0 to 1"):
        replace(GroupConfig(), **{name: 1.5})
