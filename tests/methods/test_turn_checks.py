"""Turns between which the picture cannot choose, and the table can."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Frame, Mesh, Part
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods import tracking
from asdfviz.methods.refinding import turned
from asdfviz.methods.turn_checks import TurnChecks, TurnConfig, TurnTableConfig
from asdfviz.track.bodies import Body
from asdfviz.track.confidence import Evidence
from asdfviz.track.presets import FINE
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

pytestmark = pytest.mark.usefixtures("small_models")

UPRIGHT = transform_from(np.diag([1.0, -1, -1]), np.array([0.0, 0.0, 0.74]))
"""The base, 20 mm thick, on the toy's table 0.75 m away, its pillar towards the camera."""


def undecided(frame: Frame, name: str, starts: list[Transform]) -> list[Trial]:
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
    """Taken end for end about its middle, so that it stands on the pillar."""


@pytest.fixture
def lying(toy, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Lying:
    base = toy.assembly.parts["base"]
    parts = {"base": replace(base, mesh=with_pillar(base.mesh))}
    bodies = tracking.load_bodies(replace(toy.assembly, parts=parts))
    frame = toy.frame(0, {})
    tracker = Tracker(bodies, frame.camera, FINE)
    monkeypatch.setattr(tracker, "trials", undecided)
    checks = TurnChecks(parts, bodies, config=TurnConfig(table=request.param))
    wrong = turned(UPRIGHT, np.diag([1.0, -1, -1]), centre=bodies["base"].model.centre)
    return Lying(frame, tracker, checks, parts, bodies, wrong)


@pytest.mark.parametrize(
    "lying", [TurnTableConfig(), TurnTableConfig(enabled=False)], ids=["told", "off"], indirect=True
)
def test_a_part_is_turned_to_lie_on_the_table(lying: Lying, request: pytest.FixtureRequest) -> None:
    pose = lying.wrong
    for _ in range(60):
        pose = lying.checks.step(lying.frame, lying.tracker, {"base": pose}).get("base", pose)
    assert (float(-pose[2, 2]) > 0.9) == ("told" in request.node.name)


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


@pytest.mark.parametrize("wrong", [{"worse": -0.1}, {"place": -1.0}])
def test_what_the_table_cannot_mean_is_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=r"turns\.table"):
        TurnTableConfig(**wrong)


@pytest.mark.parametrize("lying", [TurnTableConfig()], indirect=True)
def test_nothing_is_ruled_out_where_nothing_is_checked(lying: Lying) -> None:
    off = TurnChecks(lying.parts, lying.bodies, config=TurnConfig(enabled=False))
    sunk = transform_from(np.eye(3), UPRIGHT[:3, 3])
    assert off.allows(lying.frame, "base", UPRIGHT, sunk)
