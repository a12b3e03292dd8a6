"""The state that is followed, where a step adds two parts of which one is in."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly, Camera, Frame, PoseEstimate, StateEstimate
from asdfviz.geometry.symmetry import symmetric_angle
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.asdf_track import AsdfTrack
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.followed_state import FollowedState
from asdfviz.methods.group_fits import GroupFits
from asdfviz.methods.group_poses import GroupConfig, GroupPoses
from asdfviz.methods.part_poses import part_shapes
from asdfviz.state.half_done import HalfDone
from asdfviz.state.lately_loose import LatelyLooseConfig
from asdfviz.state.offline import FollowedTerms

REST = AtRest(load_assembly("geared_caliper"), config=AtRestConfig())
IN_VIEW = transform_from(np.eye(3), np.array([0.0, 0.0, 0.5]))


@pytest.fixture(scope="module")
def caliper() -> Assembly:
    return load_assembly("geared_caliper")


@pytest.fixture
def followed(caliper: Assembly) -> FollowedState:
    shapes = part_shapes(caliper, surface_points=100)
    return FollowedState(caliper, shapes, None, AsdfTrackConfig())


def blank() -> Frame:
    camera = Camera(np.diag([600.0, 600.0, 1.0]), 640, 360)
    return Frame(0, 0.0, np.zeros((360, 640, 3), np.uint8), None, camera)


def after(
    followed: FollowedState, caliper: Assembly, state: int, away: tuple[str, ...], frames: int
) -> StateEstimate:
    """What is said after frames in which the state's parts are in their places, but for some."""
    frame = blank()
    aside = transform_from(np.eye(3), np.array([0.3, 0.0, 0.0]))
    poses = {
        name: PoseEstimate(name, IN_VIEW @ (aside if name in away else T), 0.95, "refined")
        for name, T in caliper.states[state].T_base_part.items()
    }
    said = None
    for _ in range(frames):
        said = followed.step(None, poses, frame, first=None, rest=REST)
    assert said is not None
    assert said.probabilities.sum() == pytest.approx(1.0)
    assert len(said.probabilities) == len(caliper.states)
    assert all(len(term) == len(caliper.states) for term in said.terms.values())
    return said


def test_what_is_kept_gives_what_was_said(followed: FollowedState, caliper: Assembly) -> None:
    """Half-done states are kept too, so the states can be decoded anew, offline."""
    said = [after(followed, caliper, 1, (), 1) for _ in range(8)]
    said += [after(followed, caliper, 2, ("wheel",), 1) for _ in range(8)]
    kept = FollowedTerms.of(said, HalfDone.of(caliper), config=AsdfTrackConfig().smoothing)
    assert kept is not None
    assert kept.gave(said)
    assert kept.offline() == [1] * 16


@pytest.mark.parametrize("out", ["pinion", "wheel"])
def test_a_step_is_done_when_its_last_part_is_in(
    followed: FollowedState, caliper: Assembly, out: str
) -> None:
    assert after(followed, caliper, 1, (), 20).index == 1
    assert after(followed, caliper, 2, (out,), 60).index == 1
    assert after(followed, caliper, 2, (), 30).index == 2


@pytest.mark.parametrize(("is_in", "out"), [("pinion", "wheel"), ("wheel", "pinion")])
def test_of_a_half_done_step_the_part_that_is_in_is_placed(
    followed: FollowedState, caliper: Assembly, is_in: str, out: str
) -> None:
    """Alone a thin gear may be taken end for end; in its place it can only lie in one way."""
    assert followed.unfolded is None
    assert after(followed, caliper, 2, (out,), 60).index == 1
    told = followed.unfolded
    assert told is not None
    state = followed.assembly.states[told.index]
    assert is_in in state.T_base_part
    assert out not in state.T_base_part
    shapes = part_shapes(caliper, surface_points=300)
    groups = GroupPoses(followed.assembly, shapes, config=GroupConfig())
    T_right = IN_VIEW @ state.T_base_part[is_in]
    upside_down = T_right @ transform_from(np.diag([1.0, -1, -1]), np.array([0.0, 0.0, 0.004]))
    poses = {
        "carriage": PoseEstimate("carriage", IN_VIEW, 0.95, "refined"),
        is_in: PoseEstimate(is_in, upside_down, 0.6, "refined"),
    }
    placed = groups.step(poses, told, blank())
    assert placed[is_in].stage == "group"
    symmetries = caliper.parts[is_in].symmetries
    assert symmetric_angle(placed[is_in].T_camera_part, upside_down, symmetries) > 2
    axes = placed[is_in].T_camera_part[:3, 2] @ T_right[:3, 2]
    assert axes > 0.99


@pytest.mark.usefixtures("small_models")
def test_the_tracker_tells_the_state_that_no_depth_was_measured(
    toy, detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Depth that measured nothing would say that nothing is hidden."""
    seen: list[Frame] = []
    monkeypatch.setattr(FollowedState, "step", lambda _, __, ___, shown, **____: seen.append(shown))
    method, frame = AsdfTrack(AsdfTrackConfig(), detector=detector), toy.frame(0)
    method.reset(toy.assembly, frame.camera, None)
    method.step(frame)
    assert [shown.depth for shown in seen] == [None]


def test_before_a_shaken_camera_poses_count_less_where_drawn_states_speak(
    caliper: Assembly, followed: FollowedState, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = ("carriage", "rule", "cover", "roller")
    rest, poses = AtRest(caliper, config=AtRestConfig()), dict[str, PoseEstimate]()
    for shift in (0.0, 0.03):
        for k, name in enumerate(names):
            T = transform_from(np.eye(3), np.array([0.2 * k + shift, 0.1 * (k % 2), 0.6]))
            poses[name] = PoseEstimate(name, T, 0.9, "tracked")
        rest.see(poses, joined=frozenset())
    assert rest.is_shaken
    still = FollowedState(
        caliper, part_shapes(caliper, surface_points=100), None, AsdfTrackConfig()
    )
    alike = np.full(len(followed.assembly.states), 1.0)
    monkeypatch.setattr(GroupFits, "step", lambda *_, **__: alike / alike.sum())
    shaken = followed.step(None, poses, blank(), first=None, rest=rest)
    calm = still.step(None, poses, blank(), first=None, rest=REST)
    assert shaken is not None
    assert calm is not None
    power = AsdfTrackConfig().relative_pose.shaken
    one, other = np.log(calm.terms["relative_pose"]), np.log(shaken.terms["relative_pose"])
    assert other - other.max() == pytest.approx(power * (one - one.max()), abs=0.05)
    assert np.ptp(one) > 1.0


def test_what_lay_loose_a_moment_ago_is_not_joined_yet(caliper: Assembly) -> None:
    """Looks tell the later state from the moment on in which nobody sees its parts any more."""
    shapes, frame = part_shapes(caliper, surface_points=100), blank()
    looks = np.where([state.index == 2 for state in caliper.states], 0.9, 0.02)
    poses = {
        name: PoseEstimate(name, IN_VIEW @ T, 0.95, "refined")
        for name, T in caliper.states[1].T_base_part.items()
    }

    def frames_until_told(lately: LatelyLooseConfig) -> int:
        followed = FollowedState(caliper, shapes, None, AsdfTrackConfig(lately_loose=lately))
        assert followed.said is None
        last = after(followed, caliper, 2, ("pinion", "wheel"), 20)
        assert last.index == 1
        assert followed.said is not None
        np.testing.assert_allclose(followed.said, last.probabilities)
        for count in range(100):
            said = followed.step(looks, poses, frame, first=None, rest=REST)
            if said is not None and said.index == 2:
                return count
        return 100

    forgetful, slow = LatelyLooseConfig(enabled=False), LatelyLooseConfig(arrives=0.3)
    usual = frames_until_told(LatelyLooseConfig())
    assert frames_until_told(forgetful) < usual < frames_until_told(slow) < 100
