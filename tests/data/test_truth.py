from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.data.sequences import open_sequence
from asdfviz.data.truth import fitting_errors, read_truth
from asdfviz.datatypes import Assembly
from asdfviz.errors import SequenceError

WriteScene = Callable[..., Any]


@pytest.mark.parametrize("kind", ["bop", "gbot"])
def test_truth_is_read_as_it_was_written(
    write_scene: WriteScene, tiny: Assembly, kind: str
) -> None:
    scene = write_scene(kind)
    truth = read_truth(scene.folder, tiny)
    assert list(truth) == [3, 4, 7]
    for index, of_frame in truth.items():
        assert of_frame.frame_index == index
        assert list(of_frame.T_camera_part) == ["base", "jaw"]
        for name, T_camera_part in of_frame.T_camera_part.items():
            np.testing.assert_allclose(T_camera_part, scene.poses[index][name], atol=1e-12)
        # The stranger stands first in the file, so the shares must follow the entries.
        assert dict(of_frame.visible) == {"base": 0.75, "jaw": 0.0}
    states = [(truth[i].state, truth[i].is_error, truth[i].attached) for i in (3, 4, 7)]
    assert states == [
        (0, False, ("base",)),
        (1, False, ("base", "jaw")),
        (1, True, ("base",)),
    ]


def test_no_truth_is_none(write_scene: WriteScene, tiny: Assembly) -> None:
    scene = write_scene("folder")
    assert read_truth(scene.folder, tiny) == {}
    assert open_sequence(scene.folder, assembly=tiny).truth(0) is None


def test_each_file_may_be_alone(write_scene: WriteScene, tiny: Assembly) -> None:
    scene = write_scene("gbot")
    (scene.folder / "states.json").unlink()
    (scene.folder / "scene_gt_info.json").unlink()
    of_frame = read_truth(scene.folder, tiny)[3]
    assert (of_frame.state, of_frame.is_error, dict(of_frame.visible)) == (None, None, {})
    scene = write_scene("gbot", name="other")
    (scene.folder / "scene_gt.json").unlink()
    of_frame = read_truth(scene.folder, tiny)[7]
    assert (of_frame.state, of_frame.is_error, dict(of_frame.T_camera_part)) == (1, True, {})


def test_sequence_hands_out_truth_by_place(write_scene: WriteScene, tiny: Assembly) -> None:
    scene = write_scene("gbot")
    gt = scene.read("scene_gt.json")
    del gt["4"]
    scene.write("scene_gt.json", gt)
    info = scene.read("scene_gt_info.json")
    del info["4"]
    scene.write("scene_gt_info.json", info)
    sequence = open_sequence(scene.folder, assembly=tiny)
    truths = [sequence.truth(place) for place in range(3)]
    assert [t and t.frame_index for t in truths] == [3, 4, 7]
    assert truths[1] is not None
    assert not truths[1].T_camera_part
    with pytest.raises(IndexError):
        sequence.truth(3)


def test_an_entry_without_parts_says_that_none_is_there(
    write_scene: WriteScene, tiny: Assembly
) -> None:
    scene = write_scene("gbot")
    gt = scene.read("scene_gt.json")
    del gt["3"]
    gt["4"] = []
    scene.write("scene_gt.json", gt)
    (scene.folder / "scene_gt_info.json").unlink()
    truth = read_truth(scene.folder, tiny)
    assert [dict(truth[i].T_camera_part) for i in (3, 4)] == [{}, {}]
    assert [truth[i].lists_parts for i in (3, 4, 7)] == [False, True, True]


def test_parts_that_nobody_checked_are_told(write_scene: WriteScene, tiny: Assembly) -> None:
    scene = write_scene("bop")
    gt = scene.read("scene_gt.json")
    del gt["4"][2]
    scene.write("scene_gt.json", gt)
    scene.write("scene_gt_info.json", {})
    scene.write("unchecked.json", {"000004": ["jaw"], "6": ["jaw"]})
    truth = read_truth(scene.folder, tiny)
    assert {i: frame.unchecked for i, frame in truth.items()} == {3: (), 4: ("jaw",), 7: ()}


def test_a_state_may_be_unknown(write_scene: WriteScene, tiny: Assembly) -> None:
    scene = write_scene("gbot")
    scene.write("states.json", [{"frame": 4, "state": None, "is_error": None, "attached": []}])
    of_frame = read_truth(scene.folder, tiny)[4]
    assert (of_frame.state, of_frame.is_error, of_frame.attached) == (None, None, ())


def test_the_name_of_an_error_is_read(write_scene: WriteScene, tiny: Assembly) -> None:
    scene = write_scene("gbot")
    error = tiny.errors[0]
    entry = {"state": error.completed, "attached": list(error.attached)}
    wrong = {**entry, "is_error": True}
    entries = [
        {"frame": 3, **entry, "is_error": False, "name": "of no error"},
        {"frame": 4, **wrong, "name": error.name},
        {"frame": 7, **wrong, "name": "unlisted"},
    ]
    scene.write("states.json", entries)
    truth = read_truth(scene.folder, tiny)
    assert [truth[i].error for i in (3, 4, 7)] == [None, error.name, "unlisted"]
    assert [fitting_errors(truth[i], tiny) for i in (3, 4, 7)] == [(), (error,), ()]
    assert fitting_errors(replace(truth[7], error=None), tiny) == (error,)
    assert fitting_errors(replace(truth[4], attached=("pin",)), tiny) == ()
    assert fitting_errors(replace(truth[4], attached=None), tiny) == (error,)


def test_repeated_numbers_go_to_the_parts_that_carry_them(
    write_scene: WriteScene, tiny: Assembly
) -> None:
    scene = write_scene("bop")
    gt = scene.read("scene_gt.json")
    entry = gt["3"][1]
    gt["3"] = [{**entry, "obj_id": 5, "cam_t_m2c": [float(k), 0.0, 400.0]} for k in range(1, 4)]
    scene.write("scene_gt.json", gt)
    found = read_truth(scene.folder, tiny)[3].T_camera_part
    assert {name: round(T[0, 3] * 1000) for name, T in found.items()} == {"pin": 1, "pin-Copy": 2}


def test_a_repeated_name_counts_once(write_scene: WriteScene, tiny: Assembly) -> None:
    scene = write_scene("gbot")
    gt, info = scene.read("scene_gt.json"), scene.read("scene_gt_info.json")
    gt["3"].append({**gt["3"][1], "cam_t_m2c": [0.0, 0.0, 900.0]})
    info["3"].append({"visib_fract": 0.1})
    scene.write("scene_gt.json", gt)
    scene.write("scene_gt_info.json", info)
    of_frame = read_truth(scene.folder, tiny)[3]
    np.testing.assert_allclose(of_frame.T_camera_part["base"], scene.poses[3]["base"], atol=1e-12)
    assert of_frame.visible["base"] == 0.75


def edit_gt(**fields: object) -> Callable[[Any], None]:
    def damage(scene: Any) -> None:
        gt = scene.read("scene_gt.json")
        gt["4"][1].update(fields)
        scene.write("scene_gt.json", gt)

    return damage


def edit_states(content: object) -> Callable[[Any], None]:
    return lambda scene: scene.write("states.json", content)


def edit_info(content: object) -> Callable[[Any], None]:
    return lambda scene: scene.write("scene_gt_info.json", content)


def edit_unchecked(content: object) -> Callable[[Any], None]:
    return lambda scene: scene.write("unchecked.json", content)


STATE = {"frame": 3, "state": 0, "is_error": False, "attached": ["base"]}


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (edit_gt(cam_R_m2c=[2, 0, 0, 0, 2, 0, 0, 0, 2]), r"'4'\[1\].*'base' is no rotation.* 8"),
        (edit_gt(cam_R_m2c=[1, 0, 0, 0, 1, 0, 0, 0, -1]), r"no rotation \(determinant -1"),
        (edit_gt(cam_R_m2c=[1, 0, 0]), r"'cam_R_m2c': expected 9 finite numbers"),
        (edit_gt(cam_t_m2c=[0, 0, float("nan")]), r"'cam_t_m2c': expected 3 finite numbers"),
        (edit_gt(cam_t_m2c=None), r"'cam_t_m2c' is missing"),
        (edit_info({"4": [{"visib_fract": 1.0}]}), r"frame 4 has 1 entries, but .* has 3"),
        (edit_info({"4": [{"visib_fract": 7}] * 3}), r"a share from 0 to 1, got 7"),
        (edit_states({}), r"states\.json: expected a list"),
        (edit_states([{"frame": 3}]), r"'state' is missing"),
        (edit_states([{**STATE, "frame": "3"}]), r"'frame': expected a whole number"),
        (edit_states([{**STATE, "state": 2}]), r"is 2, but tiny has the correct states 0 to 1"),
        (edit_states([{**STATE, "state": -1}]), r"is -1"),
        (edit_states([{**STATE, "state": True}]), r"'state': expected a whole number"),
        (edit_states([{**STATE, "is_error": 1}]), r"'is_error': expected true or false"),
        (edit_states([{**STATE, "attached": ["nut"]}]), r"no part 'nut'; parts: base, jaw"),
        (edit_states([{**STATE, "frame": -1}]), r"'frame': expected a frame number, 0 or more"),
        (edit_gt(cam_t_m2c=[0, 0, 1e300]), r"'cam_t_m2c': expected millimetres"),
        (edit_unchecked({"9" * 5000: []}), r"a frame number like 0 or 000000 is expected"),
        (edit_states([STATE, STATE]), r"frame 3 has a second entry"),
        (edit_unchecked({"4": ["nut"]}), r"unchecked.*'4'.*no part 'nut'; parts: base, jaw"),
        (edit_unchecked({"four": []}), r"unchecked.*four"),
        (edit_unchecked({"4": ["jaw"]}), r"unchecked\.json: frame 4 names 'jaw', which has a pose"),
    ],
)
def test_broken_truth_is_refused_with_its_place(
    write_scene: WriteScene, tiny: Assembly, damage: Callable[[Any], None], message: str
) -> None:
    scene = write_scene("gbot")
    damage(scene)
    with pytest.raises(SequenceError, match=message):
        read_truth(scene.folder, tiny)
