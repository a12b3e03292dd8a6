"""asdf_track while a board hides the block, and something just like it lies elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Frame, PoseEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from
from asdfviz.methods import part_tracks
from asdfviz.methods.asdf_track import AsdfTrack
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.part_tracks import PartTracks
from asdfviz.methods.refinding import RefindConfig
from asdfviz.methods.still_there import StillThereConfig
from asdfviz.methods.track_memory import Track
from asdfviz.methods.turn_checks import TurnChecks
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.track.presets import PROPOSED

pytestmark = pytest.mark.usefixtures("small_models", "shapes_unchecked")

BASE = transform_from(np.eye(3), np.array([0.0, 0.0, 0.6]))
BLOCK = transform_from(np.eye(3), np.array([-0.15, -0.05, 0.6]))
LIKE_IT = transform_from(np.eye(3), np.array([0.18, 0.08, 0.6]))
HIDDEN = 8
"""Frame from which the board is there."""
FRAMES = 16


def frames(toy) -> list[Frame]:
    """Coloured boxes on a grey table; the board comes near the camera."""
    box = toy.detection("block", BLOCK).box_xyxy + np.array([-12, -12, 12, 12])
    place = np.round(box).astype(int)
    made: list[Frame] = []
    for i in range(FRAMES):
        base, block = toy.depth({"base": BASE}), toy.depth({"block": BLOCK})
        block = np.minimum(block, toy.depth({"block": LIKE_IT}))
        rgb = np.where((base < 0.7)[:, :, None], (30, 60, 200), (110, 115, 120))
        rgb = np.where((block < 0.7)[:, :, None], (220, 120, 20), rgb)
        depth = np.minimum(base, block)
        if i >= HIDDEN:
            rows, columns = slice(place[1], place[3]), slice(place[0], place[2])
            rgb[rows, columns], depth[rows, columns] = (60, 90, 60), 0.4
        noise = np.random.default_rng(i).normal(size=rgb.shape) * 3
        rgb = np.clip(rgb + noise, 0, 255).astype(np.uint8)
        rgb[0, 0] = i  # what the fake detector reads
        made.append(replace(toy.frame(i), rgb=rgb, depth=depth.astype(np.float32)))
    return made


def tracks_of(toy, shots: list[Frame]) -> PartTracks:
    return PartTracks(
        toy.assembly, shots[0].camera, tracker=PROPOSED, refind=RefindConfig(), turns=TurnConfig()
    )


def last_seen(
    toy, detector, shots: list[Frame], found: list[Transform], config: StillThereConfig
) -> Transform | None:
    """Where the block is said to be at the end, if it is found so frame by frame."""
    for i, T in enumerate(found):
        detector.answers[i] = (toy.detection("base", BASE), toy.detection("block", T))
    method = AsdfTrack(AsdfTrackConfig(still_there=config), detector=detector)
    method.reset(toy.assembly, shots[0].camera, None)
    said = [method.step(shots[i]) for i in range(len(found))][-1].poses.get("block")
    return None if said is None else said.T_camera_part


def test_a_hidden_part_is_not_taken_for_what_lay_elsewhere_all_along(toy, detector) -> None:
    shots = frames(toy)
    found = [BLOCK] * HIDDEN + [LIKE_IT] * (FRAMES - HIDDEN)
    there = last_seen(toy, detector, shots, found, StillThereConfig())
    assert there is not None
    np.testing.assert_allclose(there[:3, 3], BLOCK[:3, 3], atol=5e-3)
    believed = last_seen(toy, detector, shots, found, StillThereConfig(enabled=False))
    assert believed is not None
    np.testing.assert_allclose(believed[:3, 3], LIKE_IT[:3, 3], atol=5e-3)


def test_what_the_detector_said_of_one_place_does_not_speak_for_the_next(toy) -> None:
    shots = frames(toy)
    parts = tracks_of(toy, shots)
    for frame in shots[: HIDDEN + 1]:
        T = BLOCK if frame.index < HIDDEN else LIKE_IT
        assert frame.index < HIDDEN or parts.tracks["block"].is_established
        parts.refind(frame, {"block": PoseEstimate("block", T, 0.8, "refined")}, {}, None)
        parts.tracker.move(frame)
        parts.settle(frame, frozenset())
    track = parts.tracks["block"]
    np.testing.assert_allclose(track.T_now[:3, 3], LIKE_IT[:3, 3], atol=5e-3)
    assert track.support.own == 0
    assert not track.is_established


@pytest.mark.parametrize("joined", [True, False])
def test_the_detector_moves_no_part_that_the_state_joins_and_the_tracker_is_sure_of(
    toy, monkeypatch: pytest.MonkeyPatch, *, joined: bool
) -> None:
    shots = frames(toy)
    parts = tracks_of(toy, shots)
    parts.begin(shots[0], {"block": BLOCK})
    parts.tracks["block"].joined, parts.tracks["block"].age = joined, 9
    heard: list[PoseEstimate | None] = []

    def listen(track: Track, proposal: PoseEstimate | None, **_: object) -> list[Transform]:
        heard.append(proposal)
        return [track.T_now]

    monkeypatch.setattr(part_tracks, "carried_on", listen)
    elsewhere = PoseEstimate("block", LIKE_IT, 0.9, "refined")
    parts.refind(shots[0], {"block": elsewhere}, {}, None)
    assert heard == [None if joined else elsewhere]


@pytest.mark.parametrize("hidden", [False, True])
def test_of_a_hidden_part_nobody_asks_which_turn_looks_more_like_what_is_seen(
    toy, monkeypatch: pytest.MonkeyPatch, *, hidden: bool
) -> None:
    shots = frames(toy)
    parts = tracks_of(toy, shots)
    for frame in shots[:HIDDEN]:
        parts.refind(frame, {"block": PoseEstimate("block", BLOCK, 0.8, "refined")}, {}, None)
        parts.tracker.move(frame)
        parts.settle(frame, frozenset())
    asked: list[str] = []

    def in_favour(_: TurnChecks, frame: Frame, name: str, *poses: Transform) -> float:
        asked.append(name)
        return 9.0  # a turn that plainly looks better is believed at once

    monkeypatch.setattr(TurnChecks, "in_favour", in_favour)
    turned = BLOCK @ transform_from(rotation_about(np.array([0.0, 0.0, 1.0]), 1.2), np.zeros(3))
    frame = shots[HIDDEN if hidden else HIDDEN - 1]
    parts.refind(frame, {"block": PoseEstimate("block", turned, 0.8, "refined")}, {}, None)
    R_turned = BLOCK[:3, :3].T @ parts.tracker.poses["block"][:3, :3]
    assert bool(asked) is not hidden
    assert (rotation_angle(R_turned) > 0.5) is not hidden
