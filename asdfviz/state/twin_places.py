"""The different places that an assembly's states give its parts, twins together."""

from __future__ import annotations

import functools
from dataclasses import dataclass

from asdfviz.datatypes import Assembly, Joint
from asdfviz.geometry.shapes import Transform
from asdfviz.state.twins import twin_groups


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """Where some states have a part."""

    T_base_part: Transform
    joint: Joint | None
    states: tuple[int, ...]


@functools.lru_cache(maxsize=8)
def twin_places(assembly: Assembly) -> tuple[dict[str, tuple[Place, ...]], ...]:
    """The places of all twins of each part that some state joins; the same in every frame."""
    groups = (
        {name: _places(assembly, name) for name in names if name != assembly.base}
        for names in twin_groups(assembly)
    )
    return tuple(places for places in groups if any(places.values()))


def _places(assembly: Assembly, part: str) -> tuple[Place, ...]:
    """The different places of a part over all states, each with the states that share it."""
    found: dict[tuple[bytes, int], list[int]] = {}
    for state in assembly.states:
        if part in state.T_base_part:
            key = (state.T_base_part[part].tobytes(), id(state.joints.get(part)))
            found.setdefault(key, []).append(state.index)
    return tuple(
        Place(
            assembly.states[indices[0]].T_base_part[part],
            assembly.states[indices[0]].joints.get(part),
            tuple(indices),
        )
        for indices in found.values()
    )
