from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Camera, Frame, Joint, Mesh, State
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import inverse, rotation_about, rotation_angle, transform_from
from asdfviz.track.bodies import Body, centre_of_mass
from asdfviz.track.presets import GBOT, PRESETS, PROPOSED, YCB_DEPTH, YCB_ICG
from asdfviz.track.silhouettes import DrawnParts
from asdfviz.track.tracker import Tracker
from asdfviz.track.viewpoint_model import ViewpointConfig, build_viewpoint_model
from asdfviz.track.visibility import NO_SILHOUETTES, like_regions, render_silhouettes

Draw = Callable[[Mapping[str, Body], Mapping[str, Transform], int], Frame]
AddMm = Callable[[Body, Transform, Transform], float]


@pytest.fixture(scope="module")
def small_body(small_views: ViewpointConfig) -> Body:
    """A small block of its own, in another colour."""
    half = np.array([0.015, 0.015, 0.02])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    # Its corners' hull, as triangles: two for each face.
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    mesh = Mesh(corners, np.array(faces, np.int32))
    model = build_viewpoint_model(mesh, config=small_views)
    return Body(mesh, model, np.array([20, 90, 220], np.uint8), centre_of_mass(mesh))


@pytest.mark.parametrize(
    ("mode", "limit_mm"), [("region", 12.0), ("depth", 2.0), ("icg", 2.0), ("gbot", 3.0)]
)
def test_a_box_is_held_over_fifteen_frames(
    mode: str,
    limit_mm: float,
    box_body: Body,
    box_poses: list[Transform],
    camera: Camera,
    draw: Draw,
    add_mm: AddMm,
) -> None:
    tracker = Tracker({"box": box_body}, camera, PRESETS[mode])
    frames = [draw({"box": box_body}, {"box": T}, i) for i, T in enumerate(box_poses)]
    tracker.start(frames[0], {"box": box_poses[0]})
    errors = [
        add_mm(box_body, tracker.update(frame)["box"], T)
        for frame, T in zip(frames, box_poses, strict=True)
    ]
    assert max(errors) < limit_mm
    # Standing still would end more than 40 mm off.
    assert add_mm(box_body, box_poses[0], box_poses[-1]) > 40


@pytest.mark.parametrize("mode", ["depth", "icg"])
def test_a_poor_start_is_pulled_in(
    mode: str,
    box_body: Body,
    box_poses: list[Transform],
    camera: Camera,
    draw: Draw,
    add_mm: AddMm,
) -> None:
    off = transform_from(
        rotation_about(np.array([1.0, 1, 0]), 0.12), np.array([0.01, -0.006, 0.008])
    )
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 0)
    tracker = Tracker({"box": box_body}, camera, PRESETS[mode])
    tracker.start(frame, {"box": box_poses[0] @ off})
    for _ in range(8):
        tracker.update(frame)
    assert add_mm(box_body, tracker.poses["box"], box_poses[0]) < 2.0


def test_two_parts_are_told_apart_where_one_hides_the_other(
    box_body: Body,
    small_body: Body,
    box_poses: list[Transform],
    camera: Camera,
    draw: Draw,
    add_mm: AddMm,
) -> None:
    """The block crosses in front of the box: with silhouettes both stay."""
    bodies = {"box": box_body, "block": small_body}
    frames, truth = [], []
    for i, T in enumerate(box_poses):
        T_block = transform_from(
            rotation_about(np.array([0, 1.0, 0]), 0.3), np.array([-0.06 + 0.006 * i, 0.0, 0.36])
        )
        truth.append({"box": T, "block": T_block})
        frames.append(draw(bodies, truth[-1], i))
    tracker = Tracker(bodies, camera, replace(YCB_ICG, silhouettes=True))
    tracker.start(frames[0], truth[0])
    for frame, poses in zip(frames, truth, strict=True):
        tracked = tracker.update(frame)
        for name, T in poses.items():
            assert add_mm(bodies[name], tracked[name], T) < 4.0


def test_a_state_holds_parts_together_and_its_joint_slides(
    box_body: Body,
    small_body: Body,
    box_poses: list[Transform],
    camera: Camera,
    draw: Draw,
    add_mm: AddMm,
) -> None:
    bodies = {"box": box_body, "block": small_body}
    top = transform_from(np.eye(3), np.array([0.01, 0.02 - 0.045, -0.03]))
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), slide=(-0.03, 0.03))
    state = State(1, "on", {"box": np.eye(4), "block": top}, joints={"block": joint})
    frames, truth = [], []
    for i, T in enumerate(box_poses):
        slid = transform_from(np.eye(3), np.array([0.0015 * i, 0.0, 0.0])) @ top
        truth.append({"box": T, "block": T @ slid})
        frames.append(draw(bodies, truth[-1], i))
    tracker = Tracker(bodies, camera, replace(YCB_ICG, silhouettes=True))
    tracker.start(frames[0], truth[0])
    tracker.hold(state, base="box")
    for frame, poses in zip(frames, truth, strict=True):
        tracked = tracker.update(frame)
        T_box_block = inverse(tracked["box"]) @ tracked["block"]
        # What the joint does not free is exact.
        assert rotation_angle(T_box_block[:3, :3]) < 1e-6
        np.testing.assert_allclose(T_box_block[1:3, 3], top[1:3, 3], atol=1e-9)
        assert add_mm(box_body, tracked["box"], poses["box"]) < 3.0
    T_box_block = inverse(tracker.poses["box"]) @ tracker.poses["block"]
    assert T_box_block[0, 3] - top[0, 3] == pytest.approx(0.0015 * 14, abs=0.003)
    tracker.release()
    tracker.update(frames[-1])
    assert add_mm(box_body, tracker.poses["block"], truth[-1]["block"]) < 6.0


def test_what_a_held_part_hides_of_its_base_does_not_turn_it(
    box_body: Body, small_body: Body, camera: Camera, draw: Draw
) -> None:
    # The block stands out of one end of the box's front by 7 mm, nearer than depth is searched.
    on_front = transform_from(np.eye(3), np.array([0.01 + 0.03, 0.02, -0.03 - 0.007]))
    bodies = {"box": replace(box_body, color=small_body.color), "block": small_body}
    state = State(1, "on", {"box": np.eye(4), "block": on_front})
    T_camera_box = transform_from(np.eye(3), np.array([0.0, 0.0, 0.5]))
    poses = {"box": T_camera_box, "block": T_camera_box @ on_front}
    turned: dict[bool, float] = {}
    for asked in (False, True):
        settings = replace(PROPOSED, region=None, silhouettes=asked)
        tracker = Tracker(bodies, camera, settings)
        tracker.start(draw(bodies, poses, 0), poses)
        tracker.hold(state, base="box")
        for i in range(1, 6):
            tracker.update(draw(bodies, poses, i))
        turned[asked] = np.rad2deg(rotation_angle(tracker.poses["box"][:3, :3]))
    assert turned[True] < 0.5
    assert turned[False] > 2.0


def test_only_what_is_held_is_drawn_unless_loose_parts_are_wanted(
    box_body: Body, camera: Camera
) -> None:
    Ts = np.stack([transform_from(np.eye(3), np.array([x, 0.0, 0.6])) for x in (-0.1, 0.0, 0.1)])
    settings = replace(PROPOSED, silhouettes=True, silhouettes_loose=False)
    drawn = DrawnParts([box_body] * 3, camera.K, settings)
    drawn.refresh(Ts)
    assert all(drawn.of(i) is NO_SILHOUETTES for i in range(3))
    drawn.hold([2, 0])
    assert drawn.of(0) is NO_SILHOUETTES  # not drawn yet
    drawn.refresh(Ts)
    assert set(np.unique(drawn.of(0).ids)) == {-1, 0, 2}
    assert drawn.of(2) is drawn.of(0)
    assert drawn.of(1) is NO_SILHOUETTES
    every = DrawnParts([box_body] * 3, camera.K, replace(settings, silhouettes_loose=True))
    every.refresh(Ts)
    assert set(np.unique(every.of(1).ids)) == {-1, 0, 1, 2}


def test_a_drawing_without_pixels_is_refused() -> None:
    with pytest.raises(InputError, match=r"silhouette_px is -5: use 2 or more"):
        replace(PROPOSED, silhouette_px=-5)


def test_a_held_part_stays_as_it_looks_the_same(
    box_body: Body, small_body: Body, camera: Camera, draw: Draw
) -> None:
    S = transform_from(np.diag([-1.0, -1.0, 1.0]), np.zeros(3))
    bodies = {"box": box_body, "block": replace(small_body, symmetries=Symmetries(discrete=(S,)))}
    top = transform_from(np.eye(3), np.array([0.01, -0.025, -0.03]))
    joint = Joint("revolute", np.array([0.0, 0, 1]), top[:3, 3], turn=(0.0, np.pi / 2))
    state = State(1, "on", {"box": np.eye(4), "block": top}, joints={"block": joint})
    T_camera_box = transform_from(np.eye(3), np.array([0.0, 0.0, 0.5]))
    turned = top @ transform_from(rotation_about(np.array([0.0, 0, 1]), 0.4), np.zeros(3))
    poses = {"box": T_camera_box, "block": T_camera_box @ turned @ S}
    tracker = Tracker(bodies, camera, YCB_ICG)
    tracker.start(draw(bodies, poses, 0), poses)
    tracker.hold(state, base="box")
    np.testing.assert_allclose(tracker.poses["block"], T_camera_box @ turned, atol=1e-9)


def test_a_part_without_a_picture_stays_where_it_is(
    box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    tracker = Tracker({"box": box_body}, camera, YCB_ICG)
    tracker.start(draw({"box": box_body}, {"box": box_poses[0]}, 0), {"box": box_poses[0]})
    rgb = np.zeros((camera.height, camera.width, 3), np.uint8)
    empty = Frame(1, 0.1, rgb, np.zeros((camera.height, camera.width), np.float32), camera)
    tracker.replace(empty, {"box": transform_from(np.eye(3), np.array([0.0, 0.0, -1.0]))})
    behind = tracker.update(empty)["box"]
    np.testing.assert_allclose(behind[:3, 3], [0.0, 0.0, -1.0], atol=1e-12)


def test_poses_are_given_back_as_they_were_put_in(
    box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 0)
    tracker = Tracker({"box": box_body}, camera, YCB_DEPTH)
    assert tracker.poses == {}
    tracker.start(frame, {"box": box_poses[0]})
    np.testing.assert_allclose(tracker.poses["box"], box_poses[0], atol=1e-12)
    tracker.replace(frame, {"box": box_poses[3]})
    np.testing.assert_allclose(tracker.poses["box"], box_poses[3], atol=1e-12)


def test_wrong_input_is_refused_with_its_name(
    box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw
) -> None:
    frame = draw({"box": box_body}, {"box": box_poses[0]}, 0)
    tracker = Tracker({"box": box_body}, camera, YCB_ICG)
    with pytest.raises(InputError, match=r"'lid'.*bodies: box"):
        tracker.start(frame, {"lid": np.eye(4)})
    with pytest.raises(InputError, match="frame 0 has no depth"):
        tracker.start(replace(frame, depth=None), {"box": box_poses[0]})
    small = Frame(4, 0.0, frame.rgb[:100].copy(), None, camera)
    with pytest.raises(InputError, match="frame 4 is 320x100"):
        tracker.start(small, {"box": box_poses[0]})
    cropped = Camera(camera.K - np.array([[0, 0, 40.0], [0, 0, 0], [0, 0, 0]]), 320, 240)
    with pytest.raises(InputError, match=r"frame 0 has other intrinsics \(.*cx 119\.5.*cx 159\.5"):
        tracker.start(replace(frame, camera=cropped), {"box": box_poses[0]})
    tracker.start(frame, {"box": box_poses[0]})
    with pytest.raises(InputError, match="'lid' is not tracked"):
        tracker.replace(frame, {"lid": np.eye(4)})


def test_colour_alone_needs_no_depth(
    box_body: Body, box_poses: list[Transform], camera: Camera, draw: Draw, add_mm: AddMm
) -> None:
    frame = replace(draw({"box": box_body}, {"box": box_poses[0]}, 0), depth=None)
    tracker = Tracker({"box": box_body}, camera, PRESETS["region"])
    tracker.start(frame, {"box": box_poses[0]})
    assert add_mm(box_body, tracker.update(frame)["box"], box_poses[0]) < 5.0


def test_silhouettes_number_the_parts_in_the_image(
    box: Mesh, box_poses: list[Transform], camera: Camera
) -> None:
    reaches = np.linalg.norm(box.vertices, axis=1).max(keepdims=True)
    Ts = np.stack(box_poses[:1])
    drawn = render_silhouettes(
        [box], Ts, camera.K, shown=[0], size=100, reaches=reaches, regions=[0]
    )
    assert drawn is not None
    u0, v0, scale = drawn.crop
    centre = box.vertices.mean(axis=0) @ box_poses[0][:3, :3].T + box_poses[0][:3, 3]
    u, v = (camera.K @ (centre / centre[2]))[:2]
    assert drawn.ids[round((v - v0) * scale), round((u - u0) * scale)] == 0
    assert drawn.ids[0, 0] == -1
    assert max(drawn.ids.shape) <= 100
    behind = transform_from(np.eye(3), np.array([0, 0, -1.0]))[None]
    found = render_silhouettes(
        [box], behind, camera.K, shown=[0], size=100, reaches=reaches, regions=[0]
    )
    assert found is None


@pytest.mark.parametrize(
    ("colors", "expected"),
    [
        ([], []),
        ([(0, 0, 0), (200, 0, 0)], [0, 1]),
        ([(0, 0, 0), (200, 0, 0), (10, 10, 0), (190, 0, 0)], [0, 1, 0, 1]),
        ([(0, 0, 0), (60, 0, 0), (30, 0, 0)], [0, 0, 0]),
    ],
)
def test_parts_of_like_colours_share_a_region(
    colors: list[tuple[int, int, int]], expected: list[int]
) -> None:
    arrays = [np.array(c, np.uint8) for c in colors]
    found = like_regions(arrays, nearer_than=40.0)
    assert [found.index(r) for r in found] == [expected.index(r) for r in expected]


def test_the_gbot_preset_is_its_papers() -> None:
    assert GBOT.region is not None
    assert GBOT.region.scales == (9, 7, 5, 2)
    assert (GBOT.optimizer.rotation, GBOT.optimizer.translation) == (100.0, 1000.0)
