from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Camera, Frame
from asdfviz.errors import InputError, Stopped
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import is_rigid, rotation_about, rotation_angle, transform_from
from asdfviz.track.bodies import Body
from asdfviz.track.keyframes import blended, carry_keyframes, carry_parts

Draw = Callable[[Mapping[str, Body], Mapping[str, Transform], int], Frame]
AddMm = Callable[[Body, Transform, Transform], float]


@pytest.fixture(scope="module")
def frames(box_body: Body, box_poses: list[Transform], draw: Draw) -> list[Frame]:
    return [draw({"box": box_body}, {"box": T}, i) for i, T in enumerate(box_poses)]


def blank(frame: Frame) -> Frame:
    """The same frame with a board held before the camera."""
    assert frame.depth is not None
    return replace(frame, rgb=np.full_like(frame.rgb, 90), depth=np.full_like(frame.depth, 0.2))


def test_frames_between_keyframes_are_filled(
    frames: list[Frame], box_body: Body, box_poses: list[Transform], camera: Camera, add_mm: AddMm
) -> None:
    told: list[tuple[int, int]] = []
    carried = carry_keyframes(
        frames.__getitem__,
        {2: box_poses[2], 9: box_poses[9]},
        body=box_body,
        camera=camera,
        first=0,
        last=14,
        progress=lambda k, n: told.append((k, n)),
    )
    assert sorted(carried) == [k for k in range(15) if k not in (2, 9)]
    assert all(add_mm(box_body, c.T_camera_part, box_poses[k]) < 2.0 for k, c in carried.items())
    assert all(is_rigid(c.T_camera_part, tolerance=1e-9) for c in carried.values())
    # Frames, not looks at them: those between the keyframes are tracked from both sides.
    assert told[-1] == (13, 13)
    assert [k for k, _ in told] == sorted(k for k, _ in told)
    assert {n for _, n in told} == {13}


def test_each_side_stops_where_the_part_is_hidden(
    frames: list[Frame], box_body: Body, box_poses: list[Transform], camera: Camera
) -> None:
    hidden = [blank(f) if 5 <= f.index <= 9 else f for f in frames]
    carried = carry_keyframes(
        hidden.__getitem__,
        {0: box_poses[0], 14: box_poses[14]},
        body=box_body,
        camera=camera,
        first=0,
        last=14,
    )
    assert sorted(carried) == [1, 2, 3, 4, 10, 11, 12, 13]


def test_a_blend_keeps_the_centre_on_a_line_and_halves_the_turn() -> None:
    centre = np.array([0.1, 0.0, -0.2])
    T_a = transform_from(rotation_about(np.array([0, 0, 1.0]), 0.2), np.array([0.1, 0.2, 0.8]))
    T_b = transform_from(rotation_about(np.array([0, 0, 1.0]), 0.6), np.array([0.3, 0.1, 0.9]))
    T = blended(T_a, T_b, 0.5, centre=centre)
    assert rotation_angle(T_a[:3, :3].T @ T[:3, :3]) == pytest.approx(0.2, abs=1e-6)
    ends = [X[:3, :3] @ centre + X[:3, 3] for X in (T_a, T_b)]
    np.testing.assert_allclose(T[:3, :3] @ centre + T[:3, 3], (ends[0] + ends[1]) / 2)
    np.testing.assert_allclose(blended(T_a, T_b, 0.0, centre=centre), T_a, atol=1e-12)
    np.testing.assert_allclose(blended(T_a, T_b, 1.0, centre=centre), T_b, atol=1e-12)


def test_wrong_keyframes_and_a_stop(
    frames: list[Frame], box_body: Body, box_poses: list[Transform], camera: Camera
) -> None:
    def carry(keyframes: dict[int, Transform], stop: Callable[[], bool] | None = None) -> None:
        carry_keyframes(
            frames.__getitem__, keyframes, body=box_body, camera=camera, first=0, last=14, stop=stop
        )

    with pytest.raises(InputError, match="at least one frame"):
        carry({})
    with pytest.raises(InputError, match="keyframe 20 is outside of frames 0 to 14"):
        carry({20: box_poses[0]})
    with pytest.raises(Stopped):
        carry({0: box_poses[0]}, stop=lambda: True)


def test_several_parts_are_carried_in_one_pass(
    frames: list[Frame], box_body: Body, box_poses: list[Transform], camera: Camera, add_mm: AddMm
) -> None:
    """Two names of one part: each from its own keyframes, every frame read once a side."""
    read: list[int] = []

    def frame_at(place: int) -> Frame:
        read.append(place)
        return frames[place]

    carried = carry_parts(
        frame_at,
        {"a": {0: box_poses[0]}, "b": {7: box_poses[7], 14: box_poses[14]}},
        bodies={"a": box_body, "b": box_body},
        camera=camera,
        first=0,
        last=14,
    )
    assert sorted(carried["a"]) == list(range(1, 15))
    assert sorted(carried["b"]) == [k for k in range(14) if k != 7]
    assert sorted(read) == sorted([*range(15), *range(15)])
    for own in carried.values():
        assert all(add_mm(box_body, c.T_camera_part, box_poses[k]) < 2.0 for k, c in own.items())


def test_a_lost_part_is_found_again_where_the_picture_fits(
    frames: list[Frame], box_body: Body, box_poses: list[Transform], camera: Camera, add_mm: AddMm
) -> None:
    hidden = [blank(f) if 3 <= f.index <= 8 else f for f in frames]
    asked: list[int] = []

    def redetect(frame: Frame, name: str) -> Transform | None:
        asked.append(frame.index)
        if frame.index < 11:  # a wrong place, which nothing in the picture bears out
            return transform_from(np.eye(3), np.array([0.1, 0.1, 0.6]))
        off = transform_from(np.eye(3), np.array([0.006, 0.0, 0.004]))
        return off @ box_poses[frame.index]

    carried = carry_parts(
        hidden.__getitem__,
        {"box": {0: box_poses[0]}},
        bodies={"box": box_body},
        camera=camera,
        first=0,
        last=14,
        redetect=redetect,
    )["box"]
    assert sorted(carried) == [1, 2, 11, 12, 13, 14]
    assert asked == [5, 6, 7, 8, 9, 10, 11]
    assert all(add_mm(box_body, c.T_camera_part, box_poses[k]) < 2.0 for k, c in carried.items())


def test_lost_parts_are_sought_in_the_order_of_their_keyframes(
    frames: list[Frame], box_body: Body, box_poses: list[Transform], camera: Camera
) -> None:
    names = [f"box {k}" for k in range(6)]
    asked: list[str] = []
    carry_parts(
        [frames[0], *map(blank, frames[1:6])].__getitem__,
        {name: {0: box_poses[0]} for name in names},
        bodies=dict.fromkeys(names, box_body),
        camera=camera,
        first=0,
        last=5,
        redetect=lambda _, name: asked.append(name),
    )
    assert asked
    assert asked == names * (len(asked) // len(names))
