"""What the tests' own checks of types and shapes find, and what they leave alone."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from importlib import import_module, invalidate_caches
from types import ModuleType

import numpy as np
import pytest
import shape_checks

SOURCE = """
from __future__ import annotations
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, no_type_check
import numpy as np
from jaxtyping import Float64

if TYPE_CHECKING:
    from nowhere import Absent

Points = Float64[np.ndarray, "n 3"]

def moved(points: Points, by: Points | None = None, *, scale: float = 1.0) -> Points:
    return points * scale if by is None else points * scale + by

def halved(points: Points) -> Points:
    return points[::2]

def inner(points: Points) -> int:
    return len(points)

def outer(points: Points, few: Points | None = None) -> Points:
    inner(points[:1])
    return points

def all_moved(many: list[Points]) -> tuple[Points, ...]:
    return tuple(many)

def counted(count: int) -> str:
    return "x" * count if count else 0

def each(points: Points) -> Iterator[Points]:
    yield from points[:, None]

def of_absent(thing: Absent, count: int) -> Absent:
    return thing

@no_type_check
def bare(points: Points) -> Points:
    return points

@dataclass(frozen=True, slots=True)
class Cloud:
    points: Points
    weights: Float64[np.ndarray, "n"]

    def pushed(self, by: Points) -> Cloud:
        return Cloud(self.points + by, self.weights)

    @classmethod
    def made(cls, points: Points) -> Cloud:
        return cls(points, points[:, 0])

    @staticmethod
    def first(points: Points) -> Float64[np.ndarray, "3"]:
        return points[0]

    @property
    def wrong(self) -> Points:
        return self.weights
"""

P5, P4, FLAT = np.zeros((5, 3)), np.zeros((4, 3)), np.zeros((5, 2))


@pytest.fixture(scope="module")
def checked(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """A module that was imported with the checks on."""
    folder = tmp_path_factory.mktemp("checked")
    (folder / "checked_example.py").write_text(SOURCE)
    finders = list(sys.meta_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        shape_checks.install("checked_example")
        invalidate_caches()
        yield import_module("checked_example")
    sys.meta_path[:] = finders
    del sys.modules["checked_example"]


@pytest.mark.parametrize(
    "call",
    [
        lambda m: m.moved(FLAT),
        lambda m: m.moved(P5.astype(np.float32)),
        lambda m: m.moved(P5, P4),  # the same letter, another length
        lambda m: m.moved(P5, by=FLAT),
        lambda m: m.moved(P5, scale="2"),
        lambda m: m.halved(P5),  # the result's letter is the argument's
        lambda m: m.outer(P5, P4),
        lambda m: m.all_moved([FLAT]),
        lambda m: m.counted("3"),
        lambda m: m.counted(0),
        lambda m: next(m.each(FLAT)),
        lambda m: m.of_absent(None, "3"),
        lambda m: m.Cloud(FLAT, P5[:, 0]),
        lambda m: m.Cloud(P5, P4[:, 0]),
        lambda m: m.Cloud(P5, P5[:, 0]).pushed(FLAT),
        lambda m: m.Cloud.made(FLAT),
        lambda m: m.Cloud.first(FLAT),
        lambda m: m.Cloud(P5, P5[:, 0]).wrong,
    ],
)
def test_what_is_wrong_is_found(checked: ModuleType, call: Callable[[ModuleType], object]) -> None:
    with pytest.raises(Exception, match=r"violates type hint|Type-check error"):
        call(checked)


def test_what_is_right_passes_and_each_call_has_letters_of_its_own(checked: ModuleType) -> None:
    assert checked.moved(P5, P5, scale=2.0).shape == (5, 3)
    assert checked.moved(P4).shape == (4, 3)
    assert checked.outer(P5, P5) is P5  # what it calls in between has a length of its own
    assert checked.all_moved([P5, P5]) == (P5, P5)
    assert checked.counted(3) == "xxx"
    assert len(list(checked.each(P5))) == 5
    assert checked.of_absent(7, 3) == 7
    assert checked.bare(FLAT) is FLAT
    cloud = checked.Cloud.made(P5)
    assert cloud.pushed(P5).points.shape == (5, 3)
    assert checked.Cloud.first(P5).shape == (3,)
    assert checked.moved.__name__ == "moved"


def test_checks_can_be_turned_off(
    checked: ModuleType, unchecked: Callable[[], AbstractContextManager[None]]
) -> None:
    with unchecked():
        assert checked.halved(FLAT).shape == (3, 2)
    with pytest.raises(Exception, match="violates type hint"):
        checked.halved(FLAT)
