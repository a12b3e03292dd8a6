"""Arrays that are drawn: edges, boxes, keypoints, the cloud, quaternions; and the ring of pictures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.app.ar import image_plane
from asdfviz.app.drawings import (
    T_from_wxyz,
    box_segments,
    depth_cloud,
    detection_color,
    keypoint_dots,
    name_tags,
    short_labels,
    wxyz_of,
)
from asdfviz.app.outlines import MOST, feature_edges
from asdfviz.app.playback import SLOTS, Pace, Ring
from asdfviz.app.theme import ink, part_colors
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Assembly, Detection, Mesh
from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import rotation_about

K = np.array([[500.0, 0.0, 319.5], [0.0, 500.0, 239.5], [0.0, 0.0, 1.0]])
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
FACES = np.array([f for a, b, c, d in SIDES for f in ((a, b, c), (a, c, d))], np.int32)


def test_a_cube_has_twelve_edges_and_no_diagonals() -> None:
    edges = feature_edges(Mesh(CUBE, FACES))
    assert edges.shape == (12, 2, 3)
    assert np.linalg.norm(edges[:, 0] - edges[:, 1], axis=1) == pytest.approx(1.0)


def test_vertices_stored_once_a_face_are_joined() -> None:
    loose = Mesh(CUBE[FACES].reshape(-1, 3), np.arange(36, dtype=np.int32).reshape(-1, 3))
    assert len(feature_edges(loose)) == 12


def test_borders_count_and_nothing_is_nothing() -> None:
    triangle = Mesh(CUBE[:3], np.array([[0, 1, 2]], np.int32))
    assert len(feature_edges(triangle)) == 3
    assert len(feature_edges(Mesh(CUBE[:3], np.zeros((0, 3), np.int32)))) == 0


def test_edges_stay_few(clamp: Assembly) -> None:
    for part in clamp.parts.values():
        assert 0 < len(feature_edges(part.mesh)) <= MOST


def test_a_thread_takes_no_place_from_the_rest_of_the_part(
    clamp: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = {name: feature_edges(part.mesh) for name, part in clamp.parts.items()}
    monkeypatch.setattr("asdfviz.app.outlines.MOST", 10**6)
    for name, part in clamp.parts.items():
        reach = np.ptp(feature_edges(part.mesh).reshape(-1, 3), axis=0)
        assert np.ptp(drawn[name].reshape(-1, 3), axis=0) == pytest.approx(reach, rel=0.02)


@pytest.mark.parametrize("seed", range(30))
def test_quaternions_go_round(seed: int) -> None:
    rng = np.random.default_rng(seed)
    angle = np.pi if seed % 3 == 0 else rng.uniform(0, np.pi)
    R = rotation_about(rng.normal(size=3), angle)
    T = T_from_wxyz(wxyz_of(R), np.array([1.0, 2.0, 3.0]))
    assert T[:3, :3] == pytest.approx(R, abs=1e-12)
    assert T[:3, 3].tolist() == [1, 2, 3]


def make_detection(label: str, scores: np.ndarray) -> Detection:
    points = np.stack([np.linspace(100, 200, 17), np.linspace(50, 90, 17)], axis=1)
    return Detection(label, np.array([100.0, 50.0, 200.0, 90.0]), points, scores, 0.9)


def test_boxes_and_keypoints_lie_on_their_pixels(clamp: Assembly) -> None:
    colors = part_colors(clamp.parts)
    scores = np.ones(17)
    scores[0] = 0.1
    found = [make_detection(clamp.parts["jaw"].detector_class, scores)]
    segments, inks = box_segments(found, K, clamp, colors)
    pixels = project(segments.reshape(-1, 3).astype(np.float64), K)
    assert pixels.min(axis=0) == pytest.approx([100, 50], abs=1e-3)
    assert pixels.max(axis=0) == pytest.approx([200, 90], abs=1e-3)
    assert tuple(inks[0, 0]) == colors["jaw"]
    dots, _ = keypoint_dots(found, K, clamp, colors)
    assert len(dots) == 2 * 16  # the doubtful one is left out


def test_nothing_found_draws_nothing(clamp: Assembly) -> None:
    segments, inks = box_segments([], K, clamp, {})
    assert segments.shape == (0, 2, 3)
    assert inks.shape == (0, 2, 3)


def test_tags_stand_at_their_boxes_in_their_colours(clamp: Assembly) -> None:
    colors = part_colors(clamp.parts)
    label = clamp.parts["jaw"].detector_class
    one = make_detection(label, np.ones(17))
    corner = replace(one, box_xyxy=np.array([0.0, 0.0, 30.0, 20.0]))
    tags = name_tags([one, replace(one, score=0.5), corner], (640, 480), clamp, colors)
    assert tags.shape == (960, 1280, 4)
    filled = (tags[..., :3] == colors["jaw"]).all(axis=2) & (tags[..., 3] == 255)
    assert filled[99, 202]  # just above the box
    assert filled[103, 202]  # the other one, just within it
    assert filled[:45].any()  # none is cut off by the rim
    written = (tags[..., :3] == ink(colors["jaw"])).all(axis=2) & (tags[..., 3] == 255)
    assert written.sum() > 100
    assert not tags[600:].any()
    assert not name_tags([], (640, 480), clamp, colors).any()


def test_state_boxes_have_the_states_colour(clamp: Assembly) -> None:
    state = next(s for s in clamp.states if s.detector_class)
    colors = part_colors(clamp.parts)
    assert detection_color(str(state.detector_class), clamp, colors) not in colors.values()


def test_the_cloud_is_the_measured_depth(workspace: Workspace) -> None:
    points, colors = depth_cloud(workspace.frames[3], stride=4)
    assert points.shape == colors.shape == (160 * 120, 3)
    assert points[:, 2] == pytest.approx(0.6)
    assert (colors == 60).all()


class Plate:
    """A stand-in for viser's image handle."""

    def __init__(self, image: np.ndarray, *, visible: bool, **_rest: object) -> None:
        self.image, self.visible, self.removed = image, visible, False

    def remove(self) -> None:
        self.removed = True


class Plates:
    """A stand-in for viser's scene."""

    def __init__(self) -> None:
        self.made: list[Plate] = []

    def add_image(self, name: str, image: np.ndarray, **rest: Any) -> Plate:
        self.made.append(Plate(image, **rest))
        return self.made[-1]

    def shown(self) -> list[int]:
        return [int(p.image[0, 0, 0]) for p in self.made if p.visible and not p.removed]


def picture(value: int) -> np.ndarray:
    return np.full((8, 8, 3), value, np.uint8)


def test_the_ring_shows_what_was_loaded_and_one_at_a_time() -> None:
    scene = Plates()
    ring = Ring(scene, "/picture")
    plane = image_plane(K, (8, 8))
    for place in (0, 1, 9, 2, 1):
        is_new = place not in ring.places
        assert ring.load(place, picture(place), plane) is is_new
        ring.show(place)
        assert scene.shown() == [place]
    assert len(scene.made) == SLOTS


def test_frames_sent_ahead_are_there_and_do_not_show() -> None:
    scene = Plates()
    ring = Ring(scene, "/picture")
    plane = image_plane(K, (8, 8))
    ring.load(0, picture(0), plane)
    ring.show(0)
    ring.send_ahead({place: picture(place) for place in range(1, SLOTS)})
    assert scene.shown() == [0]
    for place in range(1, SLOTS):
        assert not ring.load(place, picture(place), plane)
        ring.show(place)
        assert scene.shown() == [place]


def test_another_camera_makes_other_planes() -> None:
    scene = Plates()
    ring = Ring(scene, "/picture")
    ring.load(0, picture(0), image_plane(K, (8, 8)))
    ring.load(1, picture(1), image_plane(2 * K, (8, 8)))
    ring.show(1)
    assert scene.shown() == [1]


def test_pace_keeps_time_and_does_not_hurry() -> None:
    pace = Pace()
    assert pace.wait_seconds(5.0) == 0
    pace.advance(5.0, 0.1)
    assert pace.wait_seconds(5.04) == pytest.approx(0.06)
    pace.advance(5.1, 0.1)
    assert pace.wait_seconds(5.1) == pytest.approx(0.1)
    pace.advance(9.0, 0.1)  # far too late: the next is not due at once
    assert pace.wait_seconds(9.0) == pytest.approx(0.0, abs=1e-9)
    pace.reset()
    assert pace.wait_seconds(0.0) == 0


def test_tags_leave_out_what_all_classes_begin_with(clamp: Assembly) -> None:
    parts = {
        name: replace(part, detector_class=f"Vice_{name}") for name, part in clamp.parts.items()
    }
    labels = short_labels(replace(clamp, parts=parts))
    assert [labels[f"Vice_{name}"] for name in clamp.parts] == list(clamp.parts)
    assert len(set(labels.values())) == len(labels)
