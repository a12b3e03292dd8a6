"""A thing like the block lies beside it; once a hand covers the block, it is not taken for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import pytest

from asdfviz.datatypes import Assembly, Detection
from asdfviz.errors import MethodError
from asdfviz.methods.assignment import assign_detections
from asdfviz.methods.strangers import Strangers, StrangersConfig


def found_in(
    strangers: Strangers, assembly: Assembly, detections: Sequence[Detection], times: int = 1
) -> dict[str, Detection]:
    found: dict[str, Detection] = {}
    for _ in range(times):
        found = assign_detections(strangers.told(detections), assembly)
        strangers.see(detections, found)
    return found


@pytest.fixture
def strangers(assembly: Assembly) -> Strangers:
    return Strangers(assembly, config=StrangersConfig(often=5))


def test_what_lost_often_is_not_the_part(
    assembly: Assembly, strangers: Strangers, box_at: Callable
) -> None:
    block, like = box_at("block", 20, score=0.8), box_at("block", 120, score=0.6)
    assert found_in(strangers, assembly, [block, like])["block"] is block
    assert found_in(strangers, assembly, [like])["block"] is like, "it lost once"
    found_in(strangers, assembly, [block, like], times=10)
    assert "block" not in found_in(strangers, assembly, [like])
    assert found_in(strangers, assembly, [block, like])["block"] is block
    moved = box_at("block", 160, score=0.6)
    assert found_in(strangers, assembly, [moved])["block"] is moved, "what moves is another thing"


def test_it_may_be_another_part(assembly: Assembly, strangers: Strangers, box_at: Callable) -> None:
    block = box_at("block", 20, score=0.8)
    like = replace(box_at("block", 120, score=0.6), class_scores={"pin": 0.4})
    found_in(strangers, assembly, [block, like], times=10)
    found = found_in(strangers, assembly, [like])
    assert set(found) == {"pin"}
    assert found["pin"].score == 0.4


def test_what_is_disowned_is_not_the_part_though_it_won(
    assembly: Assembly, strangers: Strangers, box_at: Callable
) -> None:
    block, like = box_at("block", 20, score=0.5), box_at("block", 120, score=0.8)
    assert found_in(strangers, assembly, [block, like])["block"] is like
    strangers.disown([like])
    assert found_in(strangers, assembly, [block, like])["block"] is block
    assert "block" not in found_in(strangers, assembly, [like])
    moved = box_at("block", 160, score=0.6)
    assert found_in(strangers, assembly, [moved])["block"] is moved
    off = Strangers(assembly, config=StrangersConfig(enabled=False))
    found_in(off, assembly, [like])
    off.disown([like])
    assert found_in(off, assembly, [like])["block"] is like


def test_what_is_as_likely_has_not_lost(
    assembly: Assembly, strangers: Strangers, box_at: Callable
) -> None:
    block, like = box_at("block", 20, score=0.65), box_at("block", 120, score=0.6)
    found_in(strangers, assembly, [block, like], times=20)
    assert found_in(strangers, assembly, [like])["block"] is like


def test_a_victory_makes_up_for_a_defeat(
    assembly: Assembly, strangers: Strangers, box_at: Callable
) -> None:
    block, like = box_at("block", 20, score=0.8), box_at("block", 120, score=0.6)
    found_in(strangers, assembly, [like], times=15)
    found_in(strangers, assembly, [block, like], times=15)
    assert found_in(strangers, assembly, [like])["block"] is like
    found_in(strangers, assembly, [block, like], times=10)
    assert "block" not in found_in(strangers, assembly, [like])


def test_it_can_be_switched_off(assembly: Assembly, box_at: Callable) -> None:
    off = Strangers(assembly, config=StrangersConfig(enabled=False))
    block, like = box_at("block", 20, score=0.8), box_at("block", 120, score=0.6)
    found_in(off, assembly, [block, like], times=40)
    assert found_in(off, assembly, [like])["block"] is like


@pytest.mark.parametrize(
    "wrong",
    [{"often": 0}, {"often": 9, "most": 5}, {"left": 1.5}, {"fades": 0.0}, {"exchanged": 0.5}],
)
def test_options_out_of_range_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match="strangers"):
        StrangersConfig(**wrong)


def test_the_part_may_come_to_where_it_lay(
    assembly: Assembly, strangers: Strangers, box_at: Callable
) -> None:
    """A place that looked like the part is not held against the part once it is there."""
    block, like = box_at("block", 20, score=0.8), box_at("block", 120, score=0.3)
    found_in(strangers, assembly, [block, like], times=20)
    assert "block" not in found_in(strangers, assembly, [replace(like, score=0.32)])
    arrived = replace(like, score=0.5)
    assert found_in(strangers, assembly, [arrived])["block"] is arrived


def test_what_it_once_scored_fades(
    assembly: Assembly, strangers: Strangers, box_at: Callable
) -> None:
    """One frame in which a hand made it look like the part says less and less."""
    block, like = box_at("block", 20, score=0.8), box_at("block", 120, score=0.3)
    arrived = replace(like, score=0.5)
    found_in(strangers, assembly, [block, like], times=20)
    found_in(strangers, assembly, [block, replace(like, score=0.55)])
    assert "block" not in found_in(strangers, assembly, [arrived])
    found_in(strangers, assembly, [block, like], times=40)
    assert found_in(strangers, assembly, [arrived])["block"] is arrived


def test_of_two_that_might_be_exchanged_neither_takes_the_others_place(
    assembly: Assembly, strangers: Strangers, box_at: Callable
) -> None:
    """The base looks more like the block than the block does, which looks like nothing else."""
    base = replace(box_at("base", 20, score=0.32), class_scores={"block": 0.64})
    block = box_at("block", 120, score=0.54)
    assert set(found_in(strangers, assembly, [base, block])) == {"base", "block"}
    assert set(found_in(strangers, assembly, [base])) == {"block"}, "nothing is known of it yet"
    found_in(strangers, assembly, [base, block], times=3)
    assert set(found_in(strangers, assembly, [base])) == {"base"}
    surely = Strangers(assembly, config=StrangersConfig(often=5, exchanged=1e6))
    found_in(surely, assembly, [base, block], times=10)
    assert set(found_in(surely, assembly, [base])) == {"block"}
