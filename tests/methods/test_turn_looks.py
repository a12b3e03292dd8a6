"""Turns of a part on a table, compared as they were settled and laid down as they look best."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from roof_scene import TABLE, TRUE, TURNED, frame, roof

from asdfviz.datatypes import Part
from asdfviz.errors import MethodError
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import symmetric_angle
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods import tracking
from asdfviz.methods.drawn_looks import DrawnConfig
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.turn_looks import TurnLooks
from asdfviz.methods.turn_table import TurnTable, TurnTableConfig

pytestmark = pytest.mark.usefixtures("small_models")

NAME = "block"


def tilted(T: Transform, degrees: float, *, up: float = 0.0) -> Transform:
    """Turned about an axis that is nearly level, and lifted, metres."""
    R = rotation_about(np.array([0.3, 1.0, 0.1]), np.radians(degrees))
    return transform_from(R @ T[:3, :3], T[:3, 3] - [0.0, 0.0, up])


@pytest.fixture
def part(toy) -> Part:
    return replace(toy.assembly.parts[NAME], mesh=roof(), diameter=diameter(roof().vertices))


def looks(toy, part: Part, *, drawn: DrawnConfig | None = None, **table: Any) -> TurnLooks:
    parts = {NAME: part}
    bodies = tracking.load_bodies(replace(toy.assembly, parts=parts, base=NAME))
    config = TurnConfig(table=TurnTableConfig(**table), drawn=drawn or DrawnConfig())
    return TurnLooks(parts, bodies, TurnTable(parts, config=config.table), config=config)


def test_the_right_turn_is_ahead_laid_down_also_if_it_was_settled_askew(toy, part) -> None:
    seen, askew = frame(), tilted(TRUE, 18.0, up=0.002)
    turns = looks(toy, part)
    told = {
        "settled": turns.ahead(seen, NAME, askew, TURNED),
        "laid": turns.laid_ahead(seen, NAME, askew, TURNED),
        "laid, the other way": turns.laid_ahead(seen, NAME, TURNED, askew),
        "laid, the same": turns.laid_ahead(seen, NAME, askew, TRUE),
    }
    ahead = {how: value for how, value in told.items() if value is not None}
    assert ahead["settled"] > 0.0, "askew it looks worse than the wrong one"
    assert ahead["laid"] < -0.05
    assert ahead["laid, the other way"] > 0.05
    assert ahead["laid, the same"] == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("is_now", [True, False])
def test_what_does_not_lie_is_not_laid_down(toy, part, *, is_now: bool) -> None:
    turns, seen = looks(toy, part), frame()
    for held in (tilted(TRUE, 0.0, up=0.03), tilted(TRUE, 45.0, up=0.012)):
        both = (held, TURNED) if is_now else (TURNED, held)
        assert turns.laid_ahead(seen, NAME, *both) is None


def test_without_a_table_or_drawings_nothing_is_laid_down(toy, part) -> None:
    seen = frame()
    assert looks(toy, part, enabled=False).laid_ahead(seen, NAME, TRUE, TURNED) is None
    assert looks(toy, part, lies=0.0).laid_ahead(seen, NAME, TRUE, TURNED) is None
    off = looks(toy, part, drawn=DrawnConfig(enabled=False))
    assert off.laid_ahead(seen, NAME, TRUE, TURNED) is None
    assert off.ahead(seen, NAME, TRUE, TURNED) is None
    blind = replace(seen, depth=None)
    assert looks(toy, part).laid_ahead(blind, NAME, TRUE, TURNED) is None


def test_a_pose_is_stood_on_the_side_that_is_near(toy, part) -> None:
    table = TurnTable({NAME: part}, config=TurnTableConfig())
    stood = table.stood(NAME, tilted(TRUE, 8.0, up=0.002), TABLE)
    assert stood is not None
    upright = symmetric_angle(stood, TRUE, part.symmetries)
    assert np.degrees(upright) < 3.0, "about the upright it stays as it was"
    assert table.stood(NAME, tilted(TRUE, 8.0, up=0.02), TABLE) is None
    few = TurnTable({NAME: part}, config=TurnTableConfig(lies_deg=5.0))
    assert few.stood(NAME, tilted(TRUE, 8.0), TABLE) is None


@pytest.mark.parametrize("wrong", [{"lies": -0.01}, {"lies_deg": -1.0}])
def test_a_limit_below_nothing_is_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match=r"turns\.table"):
        TurnTableConfig(**wrong)
