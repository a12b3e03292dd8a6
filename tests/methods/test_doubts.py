"""Poses that fit the picture, and what the detector and the colours of before say of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, Stage
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.doubts import DoubtConfig, contested, doubted
from asdfviz.methods.own_colors import OwnColors, OwnColorsConfig
from asdfviz.methods.place_support import PlaceSupport
from asdfviz.methods.track_memory import Track
from asdfviz.methods.turn_config import TurnConfig

pytestmark = pytest.mark.usefixtures("shapes_unchecked")

HERE = transform_from(np.eye(3), np.array([0.0, 0.0, 0.6]))
PART = "block"
RED, WINE, SKIN = (190, 30, 30), (190, 46, 46), (205, 160, 140)


def painted(toy, color: tuple[int, int, int]) -> Frame:
    """The part in a colour, on grey."""
    rgb = np.full((*toy.depth({}).shape, 3), 110, np.uint8)
    rgb[toy.depth({PART: HERE}) < 0.7] = color
    return replace(toy.frame(0), rgb=rgb, depth=toy.depth({PART: HERE}))


def score(
    toy,
    assembly: Assembly,
    color: tuple[int, int, int] = RED,
    *,
    support: float = 4.0,
    joined: bool = False,
    before: tuple[int, int, int] | None = RED,
    config: DoubtConfig | None = None,
) -> float:
    """Of a pose at 0.9 by itself, of a part that was of another colour before."""
    own = OwnColors(assembly, config=OwnColorsConfig())
    if before is not None:
        own.see(painted(toy, before), {PART: HERE})
    track = Track(HERE, joined=joined, support=PlaceSupport(own=support))
    poses = {PART: PoseEstimate(PART, HERE, 0.9, "tracked")}
    told = doubted(poses, {PART: track}, own, painted(toy, color), config=config or DoubtConfig())
    assert told[PART].T_camera_part is poses[PART].T_camera_part
    return told[PART].score


def test_what_the_detector_finds_and_has_its_colour_is_as_sure_as_it_fits(
    toy, assembly: Assembly
) -> None:
    assert score(toy, assembly) == pytest.approx(0.9)
    assert score(toy, assembly, before=None) == pytest.approx(0.9), "nothing known"


def test_what_only_the_tracker_finds_is_less_sure_unless_the_state_holds_it(
    toy, assembly: Assembly
) -> None:
    assert score(toy, assembly, support=0.0) == pytest.approx(0.36)
    assert score(toy, assembly, support=0.5) == pytest.approx(0.63)
    assert score(toy, assembly, support=0.0, joined=True) == pytest.approx(0.9)
    held = DoubtConfig(unfound=1.0)
    assert score(toy, assembly, support=0.0, config=held) == pytest.approx(0.9)


def test_what_has_the_tint_of_skin_is_no_red_part(toy, assembly: Assembly) -> None:
    assert score(toy, assembly, SKIN) == pytest.approx(0.09)
    assert score(toy, assembly, SKIN, joined=True) == pytest.approx(0.09)
    assert score(toy, assembly, SKIN, before=None) == pytest.approx(0.9)
    assert 0.4 < score(toy, assembly, WINE, config=DoubtConfig(tint=(0.0, 0.6))) < 0.85
    darker = (80, 13, 13)
    assert score(toy, assembly, darker) == pytest.approx(0.9), "a shadow is no other tint"


@pytest.mark.parametrize(
    "options",
    [
        {"unfound": 1.5},
        {"other": -0.1},
        {"found": 0.0},
        {"tint": (0.6, 0.3)},
        {"tint": (-0.1, 0.3)},
    ],
)
def test_figures_that_mean_nothing_are_refused(options: dict) -> None:
    with pytest.raises(MethodError, match="doubt"):
        DoubtConfig(**options)


@pytest.mark.parametrize("options", [{"beaten": 0.6}, {"contested": 1.1}, {"beaten_lead": 0.0}])
def test_so_are_those_of_contested_poses(options: dict) -> None:
    with pytest.raises(MethodError, match=r"turns\.contested"):
        TurnConfig(**options)


@pytest.mark.parametrize(
    ("ahead", "stage", "left"),
    [
        (-0.1, "tracked", 1.0),
        (0.0, "tracked", 1.0),
        (0.1, "tracked", 0.3),
        (0.2, "tracked", 0.1),
        (3.0, "tracked", 0.1),
        (3.0, "group", 1.0),
    ],
)
def test_a_pose_of_which_another_turn_is_ahead_is_less_sure(
    ahead: float, stage: Stage, left: float
) -> None:
    poses = {PART: PoseEstimate(PART, HERE, 0.9, stage)}
    told = contested(poses, {PART: ahead}, config=TurnConfig())
    assert told[PART].score == pytest.approx(0.9 * left)
    assert contested(poses, {}, config=TurnConfig())[PART].score == 0.9, "turns not checked"


@pytest.mark.parametrize(("ahead", "left"), [(0.02, 0.91), (0.1, 0.55), (0.2, 0.1)])
def test_it_may_be_the_less_sure_the_farther_that_is_ahead(ahead: float, left: float) -> None:
    config = TurnConfig(contested=1.0)
    poses = {PART: PoseEstimate(PART, HERE, 0.9, "refined")}
    assert contested(poses, {PART: ahead}, config=config)[PART].score == pytest.approx(0.9 * left)
