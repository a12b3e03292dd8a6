"""Detector and crop network against a track that hardly fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate
from asdfviz.detector.crop_answer import CropAnswer
from asdfviz.detector.crop_cut import crop_camera
from asdfviz.errors import MethodError
from asdfviz.geometry.rotation_grid import quaternion_of
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.disowned import DisownedConfig, is_disowned
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.track_memory import Track
from asdfviz.pose.hypotheses import Settled
from asdfviz.track.confidence import Evidence
from asdfviz.track.starts import Trial

RIGHT = transform_from(np.eye(3), np.array([0.0, 0.0, 0.6]))
WRONG = transform_from(rotation_about(np.array([0.0, 0, 1]), 2.0), np.array([0.02, 0.0, 0.6]))
POOR, FINE = Evidence(0.3, 0.5, 1.0), Evidence(0.9, 0.9, 1.0)

Settle = Callable[[Sequence[Transform]], list[Trial]]


@pytest.fixture
def look(box_at: Callable) -> LookedAt:
    """The network sees the part as it is, in front of the camera."""
    box = box_at("block", 150)
    camera = crop_camera(np.array([140.0, 110, 180, 130]), _K)
    seen = quaternion_of(camera.R_camera_crop.T @ RIGHT[:3, :3])[None]
    answer = CropAnswer(
        camera=camera,
        rotations=seen,
        probabilities=np.array([1.0]),
        grid=seen,
        distribution=np.ones(1),
        place=np.zeros(3),
        outline=np.ones((24, 24)),
        states=np.zeros(0),
    )
    return LookedAt((Settled(RIGHT, 0.8, refined=True),), answer, box, Symmetries())


_K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])


def settled(tracked: Evidence, *, sharp: tuple[float, float] = (0.3, 0.4)) -> Settle:
    def settle(starts: Sequence[Transform]) -> list[Trial]:
        evidence = (tracked, POOR)
        return [Trial(T, e, 0.5, sharp=s) for T, e, s in zip(starts, evidence, sharp, strict=True)]

    return settle


def frames_until(
    track: Track, look: LookedAt | None, settle: Settle, *, score: float = 0.6, **options: Any
) -> int | None:
    """Frames after which the track is disowned; None within twenty."""
    config = DisownedConfig(**options)
    proposal = PoseEstimate("block", RIGHT, score, "crop")
    for i in range(20):
        if is_disowned(track, proposal, look, settle, config=config):
            return i + 1
    return None


def test_a_track_against_which_both_networks_speak_begins_anew(look: LookedAt) -> None:
    assert frames_until(Track(WRONG), look, settled(POOR)) == 4


def test_a_track_that_fits_is_kept(look: LookedAt) -> None:
    assert frames_until(Track(WRONG), look, settled(FINE)) is None


def test_depth_must_not_speak_for_the_track(look: LookedAt) -> None:
    assert frames_until(Track(WRONG), look, settled(POOR, sharp=(0.5, 0.3))) is None


def test_one_network_alone_is_not_enough(look: LookedAt) -> None:
    assert frames_until(Track(WRONG), look, settled(POOR), score=0.2) is None
    assert frames_until(Track(WRONG), None, settled(POOR)) is None
    assert frames_until(Track(RIGHT), look, settled(POOR)) is None


def test_nobody_is_disowned_unless_asked(look: LookedAt) -> None:
    assert frames_until(Track(WRONG), look, settled(POOR), enabled=False) is None


def test_frames_for_the_track_count_too(look: LookedAt) -> None:
    track, config = Track(WRONG), DisownedConfig()
    proposal = PoseEstimate("block", RIGHT, 0.6, "crop")
    against, for_it = settled(POOR), settled(FINE)
    said = [
        is_disowned(track, proposal, look, settle, config=config)
        for settle in (against, for_it) * 5 + (against,) * 4
    ]
    assert not any(said[:-1])
    assert said[-1]


@pytest.mark.parametrize("wrong", [{"frames": 0}, {"disliked": 0.5}])
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=r"refind\.disowned"):
        DisownedConfig(**wrong)
