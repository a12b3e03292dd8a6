"""Which of like parts are loose, where the state says how many are.

Not in the paper. What goes by the name of a joined part but was found elsewhere may be a loose twin of it, or
something else. By the state so many of them are loose: the surest ones are those, whatever they are called.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping


def by_count(
    scores: Mapping[str, float],
    groups: Iterable[tuple[str, ...]],
    held: Collection[str],
    in_place: Collection[str],
) -> tuple[dict[str, str], set[str]]:
    """Give the names of loose parts to the surest of those that were found loose.

    Args:
        scores: of the parts that were found, by the names they go by.
        groups: parts that cannot be told apart; one without twins stands alone.
        held: those that surely are joined.
        in_place: of these, the ones that were found where they are joined.

    Returns:
        From the names to be changed to the new ones, a permutation; and by the new ones those that were
        found loose, though as many as are loose were surer.
    """
    changes: dict[str, str] = {}
    surplus: set[str] = set()
    for names in groups:
        free = [name for name in names if name not in held and name not in in_place]
        hidden = [name for name in names if name in held and name not in in_place]
        away = [n for n in names if n in scores and n not in in_place]
        away.sort(key=lambda name: -scores[name])
        told = {**_named(away[: len(free)], free), **_named(away[len(free) :], hidden)}
        surplus |= {told[name] for name in away[len(free) :]}
        nameless = [n for n in names if n not in told and n not in in_place]
        unused = [n for n in names if n not in told.values() and n not in in_place]
        told |= _named(nameless, unused)
        changes |= {old: new for old, new in told.items() if old != new}
    return changes, surplus


def _named(names: list[str], allowed: list[str]) -> dict[str, str]:
    """New names, the own one where it is allowed."""
    own = {name: name for name in names if name in allowed}
    left = iter([name for name in allowed if name not in own])
    return {name: own[name] if name in own else next(left) for name in names}
