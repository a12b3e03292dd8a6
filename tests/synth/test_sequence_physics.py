"""What plays may not do: let parts float, tip over or go through one another, or hands through parts."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cache
from itertools import combinations, pairwise

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.geometry.transforms import apply, inverse, rotation_angle
from asdfviz.pose.resting import center_of_mass, support_margin
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.film import Moment
from asdfviz.synth.grasping import scaled
from asdfviz.synth.hands import hand_mesh
from asdfviz.synth.penetration import Solid, depth, penetration, solid_of, surface_distance
from asdfviz.synth.routes import OFFSET_DEG, OFFSET_MM
from asdfviz.synth.script import UNLISTED
from asdfviz.synth.sequences import Play, SequenceConfig, condition_config, plan_sequence

MM = 1e-3


@dataclass(frozen=True, eq=False)
class Staged:
    """A play and whose parts it shows."""

    moments: tuple[Moment, ...]
    play: Play
    assembly: Assembly
    solids: dict[str, Solid]


@cache
def assets_of(assembly: str) -> Assets:
    return load_assets(load_assembly(assembly))


@pytest.fixture(
    scope="module",
    params=[("corner_clamp", 77), ("geared_caliper", 3), ("vise", 4), ("screw_clamp", 3)],
)
def staged(
    request: pytest.FixtureRequest, unchecked: Callable[[], AbstractContextManager[None]]
) -> Staged:
    name, seed = request.param
    config = SequenceConfig(unlisted=seed != 77)
    with unchecked():
        play = plan_sequence(assets_of(name), seed=seed, config=config)
    assembly = assets_of(name).assembly
    solids = {n: solid_of(p.mesh) for n, p in assembly.parts.items()}
    return Staged(play.moments, play, assembly, solids)


def apart(assembly: Assembly, moment: Moment) -> set[str]:
    """Parts that nothing holds and that are not joined."""
    return set(assembly.parts) - set(moment.attached) - {moment.held}


@pytest.mark.usefixtures("shapes_unchecked")
def test_parts_never_stand_in_one_another_or_in_the_table(staged: Staged) -> None:
    known: dict[tuple[str, str, bytes], float] = {}
    for moment in staged.moments:
        for name, T in moment.T_world_part.items():
            assert apply(T, staged.solids[name].samples)[:, 2].min() > -1 * MM
        for a, b in combinations(moment.T_world_part, 2):
            relative = inverse(moment.T_world_part[b]) @ moment.T_world_part[a]
            key = (a, b, np.round(relative, 6).tobytes())
            if key not in known:
                known[key] = penetration(staged.solids[a], staged.solids[b], relative)
    assert max(known.values()) < 1 * MM


@pytest.mark.usefixtures("shapes_unchecked")
def test_loose_parts_lie_still_and_steady_on_the_table(staged: Staged) -> None:
    parts = staged.assembly.parts
    seen = 0
    for before, now in pairwise(staged.moments):
        for name in apart(staged.assembly, now) & apart(staged.assembly, before):
            T = now.T_world_part[name]
            if np.abs(T - before.T_world_part[name]).max() > 1e-9:
                pytest.fail(f"{name} moves by itself")
            seen += 1
            world = apply(T, parts[name].mesh.vertices)
            assert abs(world[:, 2].min()) < 1 * MM
            center = apply(T, center_of_mass(parts[name].mesh)[None])[0]
            assert support_margin(world - center, np.array([0.0, 0.0, -1.0])) > 0
    assert seen > 20


def test_what_was_assembled_is_pushed_over_the_table_as_one(staged: Staged) -> None:
    base, done = staged.assembly.base, staged.assembly.steps[-1]
    last, first = staged.moments[-1].T_world_part, staged.moments[0].T_world_part
    assert np.linalg.norm(last[base][:3, 3] - first[base][:3, 3]) > 5 * MM
    pushed = 0
    for before, now in pairwise(m for m in staged.moments if m.state.name == done.name):
        if np.array_equal(before.T_world_part[base], now.T_world_part[base]):
            continue
        pushed += 1
        for name in done.attached:
            was, stays = (
                inverse(m.T_world_part[base]) @ m.T_world_part[name] for m in (before, now)
            )
            assert np.abs(stays - was).max() < 1e-9
    assert pushed > 1


def test_joints_of_one_link_are_at_one_share_of_their_travel(staged: Staged) -> None:
    done, last = staged.assembly.steps[-1], staged.moments[-1].T_world_part
    shares: dict[str, list[float]] = {}
    for name, joint in done.joints.items():
        low, high = joint.slide
        if joint.link and high > low:
            T_base_part = inverse(last[staged.assembly.base]) @ last[name]
            T_motion = T_base_part @ inverse(done.T_base_part[name])
            along = (apply(T_motion, joint.origin[None])[0] - joint.origin) @ joint.axis
            shares.setdefault(joint.link, []).append((along - low) / (high - low))
    assert all(np.ptp(told) < 1e-6 for told in shares.values())


def test_all_that_lies_on_the_table_is_in_view(staged: Staged) -> None:
    table = staged.play.table
    for name, T in staged.moments[0].T_world_part.items():
        points = apply(table.T_camera_world @ T, staged.assembly.parts[name].mesh.vertices)
        pixels = points @ table.K.T
        assert (pixels[:, :2] > 0).all()
        assert (pixels[:, 0] < table.width * pixels[:, 2]).all()
        assert (pixels[:, 1] < table.height * pixels[:, 2]).all()


@pytest.mark.usefixtures("shapes_unchecked")
def test_hands_stay_out_of_parts_and_touch_what_they_hold(staged: Staged) -> None:
    worst, touching = 0.0, []
    for moment in staged.moments:
        if moment.T_world_hand is None:
            continue
        hand = hand_mesh(moment.grasp)
        T_world_hand = scaled(moment.T_world_hand, staged.play.outfit)
        world = apply(T_world_hand, hand.mesh.vertices)
        for name, T in moment.T_world_part.items():
            worst = max(worst, depth(apply(inverse(T), world), staged.solids[name]))
        if moment.held is not None:
            pads = np.array([-0.5, 0.5])[:, None] * hand.gap * hand.pinch
            inner = inverse(moment.T_world_part[moment.held])
            at_part = apply(inner, apply(T_world_hand, pads))
            touching.append(surface_distance(at_part, staged.solids[moment.held]))
    assert worst < 5 * MM
    distances = np.array(touching)
    assert len(distances) > 20
    assert distances.max() < 5 * MM


def test_errors_can_be_chosen_and_unknown_ones_are_named(toy_assets: Assets) -> None:
    config = SequenceConfig(error="block_turned", hands=False)
    names = {m.state.name for m in plan_sequence(toy_assets, seed=3, config=config).moments}
    assert "block_turned" in names
    none = SequenceConfig(error=False, hands=False)
    assert not any(m.state.is_error for m in plan_sequence(toy_assets, seed=3, config=none).moments)
    with pytest.raises(InputError, match="block_turned"):
        plan_sequence(toy_assets, seed=3, config=SequenceConfig(error="upside_down"))


def test_an_unlisted_place_is_off_as_far_as_said(toy_assets: Assets) -> None:
    config = SequenceConfig(error=False, unlisted=True, hands=False)
    moments = plan_sequence(toy_assets, seed=4, config=config).moments
    wrong = [m for m in moments if m.state.name == UNLISTED]
    assert len(wrong) >= 2
    for moment in wrong:
        assert moment.held is not None
        assert moment.state.is_error
        done = toy_assets.assembly.states[moment.state.completed]
        goal = plan_goal(moments, moment.held)
        T = inverse(moment.T_world_part["plate"]) @ moment.T_world_part[moment.held]
        off = rotation_angle(goal[:3, :3].T @ T[:3, :3])
        assert OFFSET_DEG[0] - 0.1 < np.degrees(off) < OFFSET_DEG[1] + 0.1
        far = np.linalg.norm(T[:3, 3] - goal[:3, 3]) / MM
        assert OFFSET_MM[0] - 0.1 < far < OFFSET_MM[1] + 0.1
        assert set(moment.attached) == {*done.attached, moment.held}


def plan_goal(moments: tuple[Moment, ...], name: str) -> np.ndarray:
    """Where a part ends up on the base."""
    last = moments[-1].T_world_part
    return inverse(last["plate"]) @ last[name]


@pytest.mark.parametrize("fps", [3.0, 30.0])
def test_parts_keep_the_pace_at_every_rate(toy_assets: Assets, fps: float) -> None:
    config = condition_config("normal", fps=fps)
    moments = plan_sequence(toy_assets, seed=5, config=config).moments
    allowed = min(0.25 / fps, 0.025), min(2.0 / fps, np.radians(12))
    for before, now in pairwise(moments):
        assert now.T_world_hand is None
        for name, T in now.T_world_part.items():
            step = np.linalg.norm(T[:3, 3] - before.T_world_part[name][:3, 3])
            assert step < allowed[0] * 1.01
            turn = rotation_angle(T[:3, :3].T @ before.T_world_part[name][:3, :3])
            assert turn < allowed[1] * 1.01


def test_states_last_as_many_frames_as_wished(toy_assets: Assets) -> None:
    config = condition_config("normal", frames_per_state=40, error=False)
    names = [m.state.name for m in plan_sequence(toy_assets, seed=6, config=config).moments]
    assert [names.count(n) for n in ("plate", "block", "bar")] == [40, 40, 40]


def test_conditions_differ_and_unknown_ones_are_named() -> None:
    assert not condition_config("normal").hands
    assert condition_config("dynamic").light_speed > 0
    assert condition_config("hand").covering_hand
    assert condition_config("blur").exposures > 1
    assert condition_config("blur", fps=5.0).fps == 5.0
    with pytest.raises(InputError, match="normal"):
        condition_config("rain")
