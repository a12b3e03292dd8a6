"""How sure parts are told that the state holds and that something hides."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate
from asdfviz.methods.hidden_parts import sure_as_the_base
from asdfviz.methods.track_memory import Track

POSES = {
    "base": PoseEstimate("base", np.eye(4), 0.9, "tracked"),
    "part": PoseEstimate("part", np.eye(4), 0.02, "group"),
}


def told(track: Track, *, share: float = 0.8) -> float:
    tracks = {"base": Track(np.eye(4)), "part": track}
    said = sure_as_the_base(POSES, tracks, base="base", share=share)
    assert said["base"] is POSES["base"]
    return said["part"].score


def test_a_hidden_part_that_the_state_holds_is_almost_as_sure_as_its_base() -> None:
    hidden = Track(np.eye(4), unsure=4, joined=True)
    assert told(hidden) == pytest.approx(0.72)
    assert told(hidden, share=0.0) == 0.02


@pytest.mark.parametrize(
    "track",
    [
        Track(np.eye(4), unsure=4),
        Track(np.eye(4), unsure=4, missing=1, joined=True),
        Track(np.eye(4), joined=True),
    ],
    ids=["free", "seen elsewhere", "sure by itself"],
)
def test_all_others_are_as_sure_as_what_is_seen_of_them(track: Track) -> None:
    assert told(track) == 0.02


def test_a_surer_word_of_its_own_stays_and_without_a_base_all_do() -> None:
    hidden = {"base": Track(np.eye(4)), "part": Track(np.eye(4), unsure=1, joined=True)}
    low = POSES | {"base": PoseEstimate("base", np.eye(4), 0.01, "tracked")}
    assert sure_as_the_base(low, hidden, base="base", share=0.8)["part"].score == 0.02
    alone = {"part": POSES["part"]}
    assert sure_as_the_base(alone, hidden, base="base", share=0.8) == alone
