"""A pose that was carried on and others that fit, of which one is taken, watched, or let go."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate
from asdfviz.geometry.transforms import rotation_about, rotation_angle, transform_from
from asdfviz.methods.part_tracks import PartTracks
from asdfviz.methods.refinding import RefindConfig
from asdfviz.methods.rival_poses import believed, decided
from asdfviz.methods.track_memory import YOUNG, Rival, Track
from asdfviz.methods.turn_checks import TurnChecks
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.turn_looks import TurnLooks
from asdfviz.track.confidence import Evidence
from asdfviz.track.presets import PROPOSED
from asdfviz.track.starts import Trial

HERE = transform_from(np.eye(3), np.array([-0.1, 0.0, 0.6]))
TURNED = transform_from(rotation_about(np.array([1.0, 0, 0]), np.pi / 2), HERE[:3, 3])
CONFIG = RefindConfig()


def trial(T: np.ndarray) -> Trial:
    return Trial(T, Evidence(0.5, 0.5, 1.0), 0.5, sharp=0.5)


def track(*, age: int = YOUNG, explore: bool = True) -> Track:
    return Track(HERE, age=age, explore=explore)


def ahead(value: float, *, clear: bool = False):
    return lambda now, other: (value, clear)


def test_what_is_clearly_better_is_taken_at_once() -> None:
    now, other = trial(HERE), trial(TURNED)
    assert decided(track(), now, [other], ahead(0.2, clear=True)) is other
    assert decided(track(), now, [other], ahead(-0.2, clear=True)) is now
    assert decided(track(), now, [], ahead(0.2, clear=True)) is now
    assert decided(track(age=0), now, [other], ahead(0.01)) is other, "a new pose is not trusted"


def test_what_is_a_little_better_is_watched_until_it_was_ahead_for_long() -> None:
    one, now, other = track(), trial(HERE), trial(TURNED)
    assert decided(one, now, [other], ahead(0.1)) is now
    assert one.rival is not None
    rival = one.rival
    for _ in range(4):
        assert believed(one, rival, now, other, ahead(0.1), config=CONFIG) is now
    assert believed(one, rival, now, other, ahead(0.1), config=CONFIG) is other
    assert one.rival is None


def test_a_rival_that_falls_behind_is_forgotten() -> None:
    one = track()
    one.rival = Rival(np.eye(4), 0.1)
    believed(one, one.rival, trial(HERE), trial(TURNED), ahead(-0.5), config=CONFIG)
    assert one.rival is None
    hidden = track(explore=False)
    decided(hidden, trial(HERE), [trial(TURNED)], ahead(0.1))
    assert hidden.rival is None, "what is hidden is left in peace"


@pytest.mark.usefixtures("small_models", "shapes_unchecked")
@pytest.mark.parametrize(("looks", "is_turned"), [(0.3, True), (-0.3, False), (None, False)])
def test_how_a_turn_would_look_counts_more_than_its_fit(
    toy, monkeypatch: pytest.MonkeyPatch, *, looks: float | None, is_turned: bool
) -> None:
    """The tracker's own colours, learnt in the wrong turn, speak for that one."""
    frame = toy.frame(0, {"block": TURNED})
    tracks = PartTracks(
        toy.assembly, frame.camera, tracker=PROPOSED, refind=CONFIG, turns=TurnConfig()
    )
    tracks.begin(frame, {"block": HERE})
    tracks.tracks["block"].age = YOUNG

    def trials(_: object, name: str, starts: list[np.ndarray], **__: object) -> list[Trial]:
        fits = [1.0 if rotation_angle(T[:3, :3]) < 0.1 else 0.3 for T in starts]
        return [
            Trial(T, Evidence(fit, fit, 1.0), fit, sharp=fit)
            for T, fit in zip(starts, fits, strict=True)
        ]

    monkeypatch.setattr(tracks.tracker, "trials", trials)
    monkeypatch.setattr(TurnLooks, "ahead", lambda *_: looks)
    monkeypatch.setattr(TurnChecks, "step", lambda *_: {})
    tracks.refind(frame, {"block": PoseEstimate("block", TURNED, 0.8, "refined")}, {}, None)
    turned = rotation_angle(tracks.tracker.poses["block"][:3, :3]) > 1.0
    assert turned == is_turned
