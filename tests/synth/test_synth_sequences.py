from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Depth
from asdfviz.geometry.transforms import apply, inverse, rotation_angle
from asdfviz.synth.assets import Assets
from asdfviz.synth.depth_sensor import DepthSensor, measure_depth
from asdfviz.synth.grasping import hand_points, scaled
from asdfviz.synth.images import generate_images
from asdfviz.synth.sequence_config import check_config
from asdfviz.synth.sequences import Play, SequenceConfig, generate_sequence, plan_sequence

pytestmark = pytest.mark.usefixtures("toy_loaded_once")

CONFIG = SequenceConfig()


@pytest.fixture(scope="module", params=[1, 2, 77])
def play(
    toy_assets: Assets,
    request: pytest.FixtureRequest,
    unchecked: Callable[[], AbstractContextManager[None]],
) -> Play:
    with unchecked():
        return plan_sequence(toy_assets, seed=request.param, config=CONFIG)


def test_every_state_comes_in_order_with_one_error_corrected(play: Play, toy: Assembly) -> None:
    names = [m.state.name for m in play.moments]
    order = [n for i, n in enumerate(names) if i == 0 or n != names[i - 1]]
    assert order == ["plate", "block_turned", "plate", "block", "bar"]
    for name in order:
        assert names.count(name) >= 3
    for moment in play.moments:
        assert moment.attached[0] == toy.base
        assert set(moment.attached) <= set(moment.state.attached) | {moment.held}


def test_loose_parts_rest_on_the_table(play: Play, toy: Assembly) -> None:
    previous = play.moments[0]
    for moment in play.moments:
        for name, T in moment.T_world_part.items():
            moved = np.abs(T - previous.T_world_part[name]).max() > 1e-9
            if name in moment.attached or name in (moment.held, previous.held) or moved:
                continue
            if name in previous.attached:
                continue
            lowest = apply(T, toy.parts[name].mesh.vertices)[:, 2].min()
            assert abs(lowest) <= 0.001
        previous = moment


def test_nothing_goes_through_the_table(play: Play, toy: Assembly) -> None:
    for moment in play.moments:
        for name, T in moment.T_world_part.items():
            assert apply(T, toy.parts[name].mesh.vertices)[:, 2].min() > -0.001
        if moment.T_world_hand is not None:
            hand = scaled(moment.T_world_hand, play.outfit)
            points = apply(hand, hand_points(moment.grasp))
            assert points[:, 2].min() > -0.005


def test_held_parts_move_with_the_hand_and_nothing_else_moves(play: Play, toy: Assembly) -> None:
    for k, (before, now) in enumerate(pairwise(play.moments)):
        for name, T in now.T_world_part.items():
            moved = np.abs(T - before.T_world_part[name]).max() > 1e-9
            if not moved:
                continue
            base_moved = now.held == toy.base and name in now.attached
            assert name == now.held or base_moved
            if name == now.held and before.held == name:
                assert now.T_world_hand is not None
                assert before.T_world_hand is not None
                in_part = [
                    inverse(m.T_world_part[name]) @ m.T_world_hand
                    for m in (before, now)
                    if m.T_world_hand is not None
                ]
                slip = np.abs(in_part[1] - in_part[0])
                assert slip[:3, :3].max() < 1e-9
                # Fingers may slip along what they push home, just before they let go of it.
                goes_on = all(m.held == name for m in play.moments[k + 1 : k + 5])
                assert np.linalg.norm(slip[:3, 3]) < (1e-9 if goes_on else 0.0101)


def test_joined_parts_are_rigid_to_the_base(play: Play, toy: Assembly) -> None:
    for before, now in zip(play.moments, play.moments[1:], strict=False):
        for name in set(before.attached) & set(now.attached):
            T_before, T_now = (
                inverse(m.T_world_part[toy.base]) @ m.T_world_part[name] for m in (before, now)
            )
            assert np.abs(T_before - T_now).max() < 1e-9


def test_the_pace_keeps_its_limits(play: Play) -> None:
    for before, now in zip(play.moments, play.moments[1:], strict=False):
        for name, T in now.T_world_part.items():
            step = np.linalg.norm(
                T[:3, 3] - before.T_world_part[name][:3, 3]
            )  # Origin is the middle.
            turn = rotation_angle(T[:3, :3].T @ before.T_world_part[name][:3, :3])
            assert step <= 0.0255
            assert turn <= np.deg2rad(12.1)


@pytest.mark.usefixtures("shapes_unchecked")
def test_a_wished_number_of_frames_is_met(toy_assets: Assets) -> None:
    free = len(plan_sequence(toy_assets, seed=5, config=CONFIG).moments)
    wished = SequenceConfig(frames=free + 25)
    assert len(plan_sequence(toy_assets, seed=5, config=wished).moments) == free + 25


@pytest.mark.usefixtures("shapes_unchecked")
def test_frames_for_each_state_are_met_where_hands_need_no_more(toy_assets: Assets) -> None:
    moments = plan_sequence(toy_assets, seed=5, config=SequenceConfig(frames_per_state=40)).moments
    names = [m.state.name for m in moments]
    assert [names.count(name) for name in ("block", "bar", "block_turned")] == [40, 40, 40]
    short = plan_sequence(toy_assets, seed=5, config=SequenceConfig(frames_per_state=1)).moments
    assert len(short) > len({m.state.name for m in short})


def test_too_few_frames_are_refused_with_the_least_number(
    toy: Assembly,
    toy_assets: Assets,
    tmp_path: Path,
    unchecked: Callable[[], AbstractContextManager[None]],
) -> None:
    def config(frames: int) -> SequenceConfig:
        return SequenceConfig(width=160, height=90, frames=frames)

    with unchecked():
        least = len(plan_sequence(toy_assets, seed=5, config=config(1)).moments)
        folder = tmp_path / "sequence"
        for frames in (1, least - 1):
            with pytest.raises(InputError, match=rf"frames is {frames}, use {least} or more"):
                generate_sequence(
                    toy,
                    seed=5,
                    folder=folder,
                    config=config(frames),
                    exactly=True,
                    stop=lambda: True,
                )
        assert not folder.exists()
        options = {"seed": 5, "folder": folder, "config": config(least), "stop": lambda: True}
        assert generate_sequence(toy, **options, exactly=True) == 0


def test_files_hold_the_script(toy: Assembly, toy_assets: Assets, tmp_path: Path) -> None:
    config = SequenceConfig(width=160, height=90)
    told: list[tuple[int, int]] = []
    folder = tmp_path / "sequence"
    count = generate_sequence(
        toy, seed=4, folder=folder, config=config, stop=lambda: len(told) > 3,
        progress=lambda done, total: told.append((done, total)),
    )  # fmt: skip
    assert count == 3
    moments = plan_sequence(toy_assets, seed=4, config=config).moments
    # How many there will be is told before the first is drawn.
    assert told == [(done, len(moments)) for done in range(4)]
    states = json.loads((folder / "states.json").read_text())
    truth = json.loads((folder / "scene_gt.json").read_text())
    for k, state in enumerate(states):
        assert state["frame"] == k
        assert state["state"] == moments[k].state.completed
        assert state["attached"] == list(moments[k].attached)
        assert [g["obj_id"] for g in truth[str(k)]] == list(moments[k].T_world_part)
    assert (folder / "depth" / "000000.png").is_file()
    assert json.loads((folder / "sequence.json").read_text())["fps"] == 10.0


def test_frames_may_be_left_out(toy: Assembly, toy_assets: Assets, tmp_path: Path) -> None:
    sparse = SequenceConfig(width=160, height=90, every=20)
    folder = tmp_path / "sequence"
    count = generate_sequence(toy, seed=7, folder=folder, config=sparse)
    moments = plan_sequence(toy_assets, seed=7, config=sparse).moments
    drawn = list(range(13, len(moments), 20))  # 7 and 13 make 20: another seed begins elsewhere
    assert count == len(drawn) > 1
    states = json.loads((folder / "states.json").read_text())
    assert [s["frame"] for s in states] == drawn
    assert [s["state"] for s in states] == [moments[k].state.completed for k in drawn]
    sequence = open_sequence(folder, assembly=toy)
    assert [sequence[k].index for k in range(len(sequence))] == drawn
    # Those that are drawn are as they would be with the others.
    whole = replace(sparse, every=1)
    asked: list[int] = []
    generate_sequence(
        toy, seed=7, folder=tmp_path / "whole", config=whole,
        stop=lambda: len(asked) > drawn[0] + 1, progress=lambda done, total: asked.append(done),
    )  # fmt: skip
    name = f"rgb/{drawn[0]:06d}.jpg"
    assert (tmp_path / "whole" / name).read_bytes() == (folder / name).read_bytes()


def test_shifted_depth_is_moved_alike_in_all_frames(
    toy: Assembly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sensors: list[DepthSensor] = []

    def seen(*given: Depth, sensor: DepthSensor, rng: np.random.Generator) -> Depth:
        sensors.append(sensor)
        return measure_depth(*given, sensor=sensor, rng=rng)

    monkeypatch.setattr("asdfviz.synth.sequences.measure_depth", seen)
    for shift in (False, True):
        config = SequenceConfig(width=160, height=90, hands=False, shift=shift)
        asked = iter((False, False, True))
        generate_sequence(
            toy, seed=4, folder=tmp_path / str(shift), config=config, stop=asked.__next__
        )
    straight, shifted = sensors[:2], sensors[2:]
    assert [sensor.shift_px for sensor in straight] == [(0.0, 0.0)] * 2
    assert shifted[0] == shifted[1]
    assert shifted[0].shift_px != (0.0, 0.0)
    names = ("rgb/000001.jpg", "scene_gt.json", "depth/000001.png")
    same = [
        (tmp_path / "False" / name).read_bytes() == (tmp_path / "True" / name).read_bytes()
        for name in names
    ]
    assert same == [True, True, False]


@pytest.mark.parametrize(
    "options",
    [
        {"fps": 0.0},
        {"fps": 60.0},
        {"frames_per_state": 0},
        {"exposures": 0},
        {"frames": 0},
        {"width": 0},
        {"height": 99999},
    ],
)
def test_impossible_recordings_are_refused(tmp_path: Path, options: dict[str, float]) -> None:
    config = SequenceConfig(**options)  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError):
        generate_sequence(load_assembly("corner_clamp"), seed=1, folder=tmp_path, config=config)


def test_frames_are_counted_in_one_way() -> None:
    check_config(SequenceConfig(frames=90))
    with pytest.raises(InputError, match="frames is 90 and frames_per_state 20, use one of them"):
        check_config(SequenceConfig(frames=90, frames_per_state=20))


def test_a_folder_begun_with_another_seed_is_refused(tmp_path: Path) -> None:
    (tmp_path / "sequence.json").write_text('{"assembly": "corner_clamp", "fps": 0, "seed": 5}')
    with pytest.raises(InputError, match="seed 5, not 6"):
        generate_images(load_assembly("corner_clamp"), count=1, seed=6, folder=tmp_path)
