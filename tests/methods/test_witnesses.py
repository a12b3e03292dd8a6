from __future__ import annotations

import numpy as np
import pytest

from asdfviz.datatypes import PoseEstimate
from asdfviz.methods.track_memory import Track
from asdfviz.methods.witnesses import witnesses


def track(own: float) -> Track:
    made = Track(np.eye(4))
    made.support.own = own
    return made


def test_poses_are_worth_what_the_detector_found_there() -> None:
    support = {"base": 0.0, "often": 2.0, "seldom": 0.8, "never": 0.0, "joined": 0.0}
    poses = {
        name: PoseEstimate(name, np.eye(4), 0.9, "group" if name == "joined" else "tracked")
        for name in support
    }
    tracks = {name: track(own) for name, own in support.items()}
    told = witnesses(poses, tracks, base="base")
    assert set(told.trusted) == {"base", "often", "seldom", "joined"}
    assert told.loose == {name: pose for name, pose in poses.items() if name != "joined"}
    assert {name: pose.score for name, pose in told.places.items()} == pytest.approx(
        {"base": 0.9, "often": 0.9, "seldom": 0.9 * 0.86, "never": 0.9 * 0.3}
    )
