"""Turns between which the picture cannot choose, and the table can."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Frame, Mesh, Part
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply_to_point, transform_from
from asdfviz.methods import tracking, turn_looks
from asdfviz.methods.asdf_plus import AsdfPlus
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.asdf_track import AsdfTrack
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.drawn_looks import DrawnConfig
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.refinding import turned
from asdfviz.methods.turn_checks import TurnChecks
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.turn_looks import TurnLooks
from asdfviz.methods.turn_table import TurnTableConfig
from asdfviz.state.part_names import PartNames
from asdfviz.track.bodies import Body
from asdfviz.track.confidence import Evidence
from asdfviz.track.presets import FINE
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

pytestmark = pytest.mark.usefixtures("small_models")

UPRIGHT = transform_from(np.diag([1.0, -1, -1]), np.array([0.0, 0.0, 0.74]))
"""The base, 20 mm thick, on the toy's table 0.75 m away, its pillar towards the camera."""


def undecided(frame: Frame, name: str, starts: list[Transform], **_: object) -> list[Trial]:
    """Trials to which every pose looks alike."""
    return [Trial(T, Evidence(0.5, 0.5, 1.0), 0.5, sharp=0.5) for T in starts]


def with_pillar(mesh: Mesh) -> Mesh:
    """A pillar of 15 mm on one side, without which the base lies alike on both."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    pillar = (mesh.vertices - (low + high) / 2) / (high - low) * [0.02, 0.02, 0.015]
    pillar += np.array([0.03, 0.0, high[2] + 0.0075])
    count = len(mesh.vertices)
    return Mesh(
        np.concatenate([mesh.vertices, pillar]), np.concatenate([mesh.faces, mesh.faces + count])
    )


@dataclass(frozen=True, eq=False)
class Lying:
    """The base with a pillar on the toy's table, and what checks its turns."""

    frame: Frame
    tracker: Tracker
    checks: TurnChecks
    parts: dict[str, Part]
    bodies: dict[str, Body]
    wrong: Transform
    """Taken end for end about its centre of mass."""


@pytest.fixture
def lying(toy, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Lying:
    base = toy.assembly.parts["base"]
    parts = {"base": replace(base, mesh=with_pillar(base.mesh))}
    bodies = tracking.load_bodies(replace(toy.assembly, parts=parts))
    frame = toy.frame(0, {})
    tracker = Tracker(bodies, frame.camera, FINE)
    monkeypatch.setattr(tracker, "trials", undecided)
    config = TurnConfig(table=request.param, drawn=DrawnConfig(enabled=False))
    checks = TurnChecks(parts, bodies, config=config)
    wrong = turned(UPRIGHT, np.diag([1.0, -1, -1]), centre=bodies["base"].balance)
    return Lying(frame, tracker, checks, parts, bodies, wrong)


@pytest.mark.parametrize(
    "lying", [TurnTableConfig(), TurnTableConfig(enabled=False)], ids=["told", "off"], indirect=True
)
def test_a_part_is_turned_to_lie_on_the_table(lying: Lying, request: pytest.FixtureRequest) -> None:
    pose = lying.wrong
    for _ in range(60):
        pose = lying.checks.step(lying.frame, lying.tracker, {"base": pose}).get("base", pose)
    assert (float(-pose[2, 2]) > 0.9) == ("told" in request.node.name)


class Upright(LookedAt):
    """A crop by which the base stands upright, whichever way it looks."""

    def __init__(self) -> None:
        """Nothing else is asked of it."""

    def likely(self, T_camera_part: Transform) -> float:
        return float(-T_camera_part[2, 2] > 0.9)


def by_crops(lying: Lying, **options: Any) -> TurnChecks:
    """Checks that neither draw the part nor ask the table."""
    drawn, table = DrawnConfig(enabled=False), TurnTableConfig(enabled=False)
    config = TurnConfig(table=table, drawn=drawn, **options)
    return TurnChecks(lying.parts, lying.bodies, config=config)


def told_upright(lying: Lying, checks: TurnChecks) -> Transform:
    """The pose, wrong at first, after sixty frames in each of which a crop said upright."""
    pose, looked_at = lying.wrong, {"base": Upright()}
    for _ in range(60):
        found = checks.step(lying.frame, lying.tracker, {"base": pose}, looked_at)
        pose = found.get("base", pose)
    return pose


@pytest.mark.parametrize("lying", [TurnTableConfig(enabled=False)], ids=["off"], indirect=True)
@pytest.mark.parametrize("liked", [0.1, 0.0])
def test_a_part_is_turned_as_the_crop_network_keeps_saying(lying: Lying, liked: float) -> None:
    checks = by_crops(lying, liked=liked)
    pose = told_upright(lying, checks)
    assert (float(-pose[2, 2]) > 0.9) == (liked > 0)


@pytest.mark.parametrize("lying", [TurnTableConfig(enabled=False)], ids=["off"], indirect=True)
@pytest.mark.parametrize(("laid", "is_turned"), [(None, True), (0.1, True), (-0.1, False)])
def test_what_looks_worse_laid_on_the_table_is_not_turned(
    lying: Lying, laid: float | None, is_turned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(TurnLooks, "laid_ahead", lambda *_: laid)
    pose = told_upright(lying, by_crops(lying))
    assert (float(-pose[2, 2]) > 0.9) == is_turned


@pytest.mark.parametrize("lying", [TurnTableConfig(enabled=False)], ids=["off"], indirect=True)
def test_a_part_of_which_another_turn_is_ahead_is_checked_before_its_turn(
    lying: Lying, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def trials(frame: Frame, name: str, starts: list[Transform], **_: object) -> list[Trial]:
        asked.append(name)
        ahead = name == "c"
        return [
            Trial(T, Evidence(0.5, 0.5, 1.0), 0.5, 0.5 + 0.03 * ahead * i)
            for i, T in enumerate(starts)
        ]

    monkeypatch.setattr(lying.tracker, "trials", trials)
    parts = dict.fromkeys("abcdef", lying.parts["base"])
    bodies = dict.fromkeys("abcdef", lying.bodies["base"])
    drawn, table = DrawnConfig(enabled=False), TurnTableConfig(enabled=False)
    config = TurnConfig(a_frame=2, lead=9.0, lead_seen=9.0, table=table, drawn=drawn)
    checks = TurnChecks(parts, bodies, config=config)
    for _ in range(6):
        checks.step(lying.frame, lying.tracker, dict.fromkeys("abcdef", UPRIGHT))
    # Both of a frame are checked side by side, so either may be first.
    pairs = ["".join(sorted(asked[i : i + 2])) for i in range(0, len(asked), 2)]
    assert pairs == ["ab", "cd", "ce", "cf", "ac", "bc"]


class UpsideDown(Upright):
    """A crop by which the base stands on its head."""

    def likely(self, T_camera_part: Transform) -> float:
        return float(T_camera_part[2, 2] > 0.9)


def sharper_upright(frame: Frame, name: str, starts: list[Transform], **_: object) -> list[Trial]:
    """Trials in which the base looks about as what is seen only where it stands upright or on its head, and
    a little more so upright."""
    seen = Evidence(0.5, 0.5, 1.0)

    def sharp(T: Transform) -> float:
        is_straight = T[0, 0] > 0.9
        return 0.3 if not is_straight else 0.58 if T[2, 2] < -0.9 else 0.5

    return [Trial(T, seen, 0.5, sharp=sharp(T)) for T in starts]


@pytest.mark.parametrize("lying", [TurnTableConfig(enabled=False)], ids=["off"], indirect=True)
@pytest.mark.parametrize(
    ("most", "lead_seen", "is_turned"), [(0.5, 9.0, True), (9.0, 9.0, False), (9.0, 0.3, True)]
)
def test_what_is_seen_in_every_frame_outweighs_what_a_network_keeps_saying(
    lying: Lying, most: float, lead_seen: float, is_turned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lying.tracker, "trials", sharper_upright)
    checks, pose = by_crops(lying, liked_most=most, lead_seen=lead_seen), lying.wrong
    for _ in range(60):
        found = checks.step(lying.frame, lying.tracker, {"base": pose}, {"base": UpsideDown()})
        pose = found.get("base", pose)
    assert (float(-pose[2, 2]) > 0.9) == is_turned


@pytest.mark.parametrize("lying", [TurnTableConfig(enabled=False)], ids=["off"], indirect=True)
@pytest.mark.parametrize(
    ("held", "is_elsewhere", "is_expected"), [(1, False, True), (1, True, False), (2, False, False)]
)
def test_of_a_part_found_anew_the_turn_is_tried_first_that_it_had_there_for_some_time(
    lying: Lying,
    held: int,
    is_elsewhere: bool,
    is_expected: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: list[list[Transform]] = []

    def trials(frame: Frame, name: str, starts: list[Transform], **_: object) -> list[Trial]:
        asked.append(starts)
        return sharper_upright(frame, name, starts)

    monkeypatch.setattr(lying.tracker, "trials", trials)
    aside = np.diag([-1.0, 1, -1])  # the third of all turns: not tried first otherwise
    had = turned(lying.wrong, aside, centre=lying.bodies["base"].balance)
    if is_elsewhere:
        had[0, 3] += 0.2
    checks = by_crops(lying, was=0.1, held=held)
    checks.step(lying.frame, lying.tracker, {"base": had})
    asked.clear()
    checks.step(lying.frame, lying.tracker, {"base": lying.wrong})
    _, *others = asked[0]
    is_first = bool(np.allclose(others[0][:3, :3], had[:3, :3], atol=1e-6))
    assert (is_first and len(others) == 1) == is_expected


@pytest.mark.parametrize("lying", [TurnTableConfig(enabled=False)], ids=["off"], indirect=True)
@pytest.mark.parametrize(("sure", "is_turned"), [(0.2, True), (0.1, False)])
def test_a_part_is_not_turned_against_its_contours(
    lying: Lying, sure: float, is_turned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They give the pose that it has a confidence of 0.5."""

    def doubted(frame: Frame, name: str, starts: list[Transform], **_: object) -> list[Trial]:
        both = {True: sure, False: 0.5}
        seen = Evidence(0.5, 0.5, 1.0)
        return [Trial(T, seen, both[bool(-T[2, 2] > 0.9)], sharp=0.5) for T in starts]

    monkeypatch.setattr(lying.tracker, "trials", doubted)
    checks = by_crops(lying)
    pose = told_upright(lying, checks)
    assert (float(-pose[2, 2]) > 0.9) == is_turned


@pytest.mark.parametrize("lying", [TurnTableConfig(enabled=False)], ids=["off"], indirect=True)
@pytest.mark.parametrize(("share", "is_allowed"), [(0.0, False), (0.35, False), (0.8, True)])
def test_a_turn_that_was_wrong_stays_wrong_where_the_part_is(
    lying: Lying, share: float, is_allowed: bool
) -> None:
    """Taken end for end, a part's middle may lie a third of its size from where it is."""
    checks = by_crops(lying)
    pose = told_upright(lying, checks)
    centre = lying.bodies["base"].model.centre
    again = lying.wrong.copy()
    again[:3, 3] += apply_to_point(pose, centre) - apply_to_point(again, centre)
    again[0, 3] += share * lying.parts["base"].diameter
    assert checks.allows(lying.frame, "base", pose, again) == is_allowed


@pytest.mark.parametrize(
    "lying", [TurnTableConfig(), TurnTableConfig(enabled=False)], ids=["told", "off"], indirect=True
)
def test_a_part_is_not_turned_into_the_table(lying: Lying, request: pytest.FixtureRequest) -> None:
    is_told, allows = "told" in request.node.name, lying.checks.allows
    sunk = transform_from(np.eye(3), UPRIGHT[:3, 3])
    assert allows(lying.frame, "base", UPRIGHT, sunk) != is_told
    assert allows(lying.frame, "base", sunk, UPRIGHT)
    elsewhere = sunk.copy()
    elsewhere[0, 3] += 0.15
    assert allows(lying.frame, "base", UPRIGHT, elsewhere), "a part that was moved may lie deeper"
    unseen = replace(lying.frame, depth=None)
    assert allows(unseen, "base", UPRIGHT, sunk)


@pytest.mark.parametrize("lying", [TurnTableConfig()], indirect=True)
def test_parts_nearby_are_drawn_where_they_are_told_to_be(
    lying: Lying, toy, monkeypatch: pytest.MonkeyPatch
) -> None:
    parts = {**toy.assembly.parts, **lying.parts}
    bodies = tracking.load_bodies(replace(toy.assembly, parts=parts))
    checks = TurnChecks(parts, bodies, config=TurnConfig())
    drawn: list[list[tuple[Mesh, Transform]]] = []

    def looks(*_: object, others: list[tuple[Mesh, Transform]], **__: object) -> np.ndarray:
        drawn.append(others)
        return np.zeros(2)

    monkeypatch.setattr(turn_looks, "drawn_looks", looks)
    beside, away = UPRIGHT.copy(), UPRIGHT.copy()
    beside[0, 3], away[0, 3] = 0.06, 0.5
    checks.in_favour(lying.frame, "base", UPRIGHT, lying.wrong)
    checks.looks.around = {"base": UPRIGHT, "block": beside, "pin": away}
    checks.in_favour(lying.frame, "base", UPRIGHT, lying.wrong)
    assert [len(others) for others in drawn] == [0, 1]
    mesh, pose = drawn[1][0]
    assert mesh is parts["block"].mesh
    np.testing.assert_array_equal(pose, beside)


@pytest.mark.parametrize("wrong", [{"worse": -0.1}, {"place": -1.0}])
def test_what_the_table_cannot_mean_is_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=r"turns\.table"):
        TurnTableConfig(**wrong)


@pytest.mark.parametrize("lying", [TurnTableConfig()], indirect=True)
def test_nothing_is_ruled_out_where_nothing_is_checked(lying: Lying) -> None:
    off = TurnChecks(lying.parts, lying.bodies, config=TurnConfig(enabled=False))
    sunk = transform_from(np.eye(3), UPRIGHT[:3, 3])
    assert off.allows(lying.frame, "base", UPRIGHT, sunk)


@pytest.mark.parametrize("lying", [TurnTableConfig()], indirect=True)
@pytest.mark.parametrize("known", [6, 0])
def test_a_part_that_is_said_to_be_turned_now_and_then_is_judged_all_the_same(
    lying: Lying, known: int
) -> None:
    """What was found of a pose is not forgotten by another one that comes every third frame."""
    config = TurnConfig(known=known, drawn=DrawnConfig(enabled=False))
    checks = TurnChecks(lying.parts, lying.bodies, config=config)
    centre = lying.bodies["base"].model.centre
    about = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    between = turned(lying.wrong, about, centre=centre)
    righted: list[bool] = []
    for i in range(30):
        pose = between if i % 3 == 2 else lying.wrong
        found = checks.step(lying.frame, lying.tracker, {"base": pose})
        righted.append("base" in found and float(-found["base"][2, 2]) > 0.9)
    assert any(righted) == (known > 0)


@pytest.mark.parametrize("lying", [TurnTableConfig(enabled=False)], ids=["off"], indirect=True)
def test_what_is_known_of_turns_goes_by_the_new_names_of_twins(lying: Lying) -> None:
    drawn, table = DrawnConfig(enabled=False), TurnTableConfig(enabled=False)
    parts = {**lying.parts, "twin": lying.parts["base"]}
    bodies = {**lying.bodies, "twin": lying.bodies["base"]}
    checks = TurnChecks(parts, bodies, config=TurnConfig(table=table, drawn=drawn))
    pose = told_upright(lying, checks)
    checks.rename({"base": "twin", "twin": "base"})
    told = {name: checks.allows(lying.frame, name, pose, lying.wrong) for name in parts}
    assert told == {"base": True, "twin": False}


def test_whoever_names_twins_anew_tells_what_remembers_their_turns(
    toy, detector, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[dict[str, str]] = []
    monkeypatch.setattr(TurnChecks, "rename", lambda _, names: told.append(names))
    names = {"pin": "pin-copy", "pin-copy": "pin"}
    monkeypatch.setattr(PartNames, "changes", lambda *_, **__: names)
    frame = toy.frame(0, {})
    for method in (
        AsdfPlus(AsdfPlusConfig(), detector=detector),
        AsdfTrack(AsdfTrackConfig(), detector=detector),
    ):
        method.reset(toy.assembly, frame.camera, None)
        method.step(frame)
    assert told == [names, names]
