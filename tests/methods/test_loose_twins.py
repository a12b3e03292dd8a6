"""Like parts, of which so many are loose."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import pytest

from asdfviz.methods.loose_twins import by_count

PINS = (("a", "b", "c"), ("lid",))


@pytest.mark.parametrize(
    ("scores", "held", "in_place", "changes", "surplus"),
    [
        # As many as are loose, by names that are.
        ({"b": 0.5, "c": 0.9}, "a", "", {}, ""),
        # One of them by the name of the joined one, which then nobody has.
        ({"a": 0.9, "c": 0.5}, "a", "", {"a": "b", "b": "a"}, ""),
        # One too many: the least sure one is none, whatever it is called.
        ({"a": 0.9, "b": 0.8, "c": 0.3}, "a", "", {"a": "c", "c": "a"}, "a"),
        ({"a": 0.3, "b": 0.8, "c": 0.9}, "a", "", {}, "a"),
        # What is in its place keeps its name.
        ({"a": 0.2, "b": 0.8, "c": 0.3}, "ab", "a", {"b": "c", "c": "b"}, "b"),
        # A part without twins.
        ({"lid": 0.9}, ["lid"], "", {}, ["lid"]),
        ({"lid": 0.9}, ["lid"], ["lid"], {}, ""),
        ({"lid": 0.9}, "", "", {}, ""),
        ({}, ["a", "lid"], "", {}, ""),
    ],
)
def test_the_surest_are_the_loose_ones(
    scores: Mapping[str, float],
    held: Collection[str],
    in_place: Collection[str],
    changes: Mapping[str, str],
    surplus: Collection[str],
) -> None:
    told, too_many = by_count(scores, PINS, list(held), list(in_place))
    assert told == changes
    assert too_many == set(surplus)
    assert sorted(told) == sorted(told.values())  # a permutation
