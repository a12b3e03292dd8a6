"""Ways on which parts reach their places: along free directions, beginning where nothing is near."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.synth.motion import moved
from asdfviz.synth.penetration import Solid, penetration

TOLERANCE = 0.0008
"""Penetration that a way may add to that of the place itself, metres."""
_OFFSETS = tuple(
    k / 1000
    for k in (3, 7, 11, 15, 19, 24, 30, 36, 42, 49, 56, 64, 72, 81, 90, 100, 110, 135, 165, 200)
)
_MEASURED = 20
"""Points within another part whose depth is measured."""
_SLIDES = tuple(k / 1000 for k in range(1, 31))
"""Where a way may have its corner: so far from the place, metres."""
_BLOCKED = 0.005
"""A direction that goes through others deeper than this is followed no farther, metres."""
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
"""Of a box of side 1."""
_LIFTS = (0.005, 0.01, 0.015, 0.02, 0.03, 0.045, 0.065, 0.09)


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A way home: straight, or with one corner (a clip goes over a neck and then along it)."""

    out: Vector
    """From the place to where the way begins, base frame, metres."""
    depth: float
    """Deepest penetration along it beyond that of the place itself, metres."""
    corner: Vector | None = None
    """From the place to where the way turns, base frame, metres; None: it is straight."""

    @property
    def stops(self) -> tuple[Vector, ...]:
        """Ends of its straight stretches, from the place outwards."""
        return (self.out,) if self.corner is None else (self.corner, self.out)


def with_steps(stops: Sequence[Vector]) -> list[Vector]:
    """The ends of a way's stretches from the place outwards, and places on the way to each of them."""
    starts = [0.0 * stops[0], *stops[:-1]] if stops else []
    return [
        a + share * (b - a)
        for a, b in zip(starts, stops, strict=True)
        for share in (0.25, 0.5, 0.75, 1.0)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A solid at its place."""

    solid: Solid
    T: Transform


def touches(a: Body, b: Body, *, least: float = 0.0, enough: float = np.inf) -> float:
    """How deep two bodies stand in each other, metres; quick if their boxes are apart.

    A depth up to `least` may be told as any other up to this, one from `enough` on as any other from
    this on, which is quicker.
    """
    T_b_a = inverse(b.T) @ a.T
    spread = a.solid.low + _CORNERS * (a.solid.high - a.solid.low)
    box = apply(T_b_a, spread)
    if bool((box.min(axis=0) > b.solid.high).any() or (box.max(axis=0) < b.solid.low).any()):
        return 0.0
    return penetration(a.solid, b.solid, T_b_a, most=_MEASURED, least=least, enough=enough)


def deepest(
    body: Body, others: Sequence[Body], *, least: float = 0.0, enough: float = np.inf
) -> float:
    """How deep a body stands in the others, metres; up to `least` and from `enough` on as `touches` tells."""
    found = 0.0
    for other in others:
        found = max(found, touches(body, other, least=max(found, least), enough=enough))
        if found >= enough:
            break
    return found


def is_free(body: Body, others: Sequence[Body], allowed: float) -> bool:
    """Whether a body stands in the others no deeper than allowed, metres."""
    return deepest(body, others, least=allowed, enough=math.nextafter(allowed, math.inf)) <= allowed


def find_way(
    body: Body, others: Sequence[Body], candidates: Sequence[Vector], T_world_base: Transform
) -> Way:
    """The first candidate on which a part comes home freely, else the way of least penetration.

    Where no straight way is free, two candidates in turn are tried.

    Args:
        body: the part at its place, base frame.
        others: what is there already, base frame.
        candidates: unit vectors in the base frame, from the place outwards.
        T_world_base: tells where the table (z = 0) is and where up is.
    """
    allowed = deepest(body, others) + TOLERANCE
    best: Way | None = None
    for direction in candidates:
        way = _along(body, others, direction, T_world_base, allowed, best)
        if way is not None and (best is None or way.depth < best.depth):
            best = way
        if best is not None and best.depth <= 0:
            return best
    best = _round_a_corner(body, others, candidates, T_world_base, allowed, best)
    return best or Way(candidates[0] * _OFFSETS[-1], np.inf)


def _round_a_corner(
    body: Body,
    others: Sequence[Body],
    candidates: Sequence[Vector],
    T_world_base: Transform,
    allowed: float,
    best: Way | None,
) -> Way | None:
    """The best way that slides along one candidate and leaves along another, or the given one."""
    allowed -= TOLERANCE / 2  # a corner may be anywhere, so one with some air is found if there is
    for slide in candidates:
        for offset in _SLIDES:
            corner = Body(body.solid, moved(body.T, offset * slide))
            if not is_free(corner, others, allowed) or lowest(corner, T_world_base) < 0.0003:
                break
            for direction in candidates:
                if abs(float(direction @ slide)) > 0.9:
                    continue
                way = _along(corner, others, direction, T_world_base, allowed, best)
                if way is not None and (best is None or way.depth < best.depth):
                    best = Way(offset * slide + way.out, way.depth, offset * slide)
                if best is not None and best.depth <= 0:
                    return best
    return best


def _along(
    body: Body,
    others: Sequence[Body],
    direction: Vector,
    T_world_base: Transform,
    allowed: float,
    best: Way | None,
) -> Way | None:
    """The way along one direction; None if it goes through the table or is worse than the best."""
    up = T_world_base[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    worst = 0.0
    # A way that is worse than the best need not be known any better.
    enough = np.inf if best is None else allowed + best.depth + 1e-9
    for offset in _OFFSETS:
        there = Body(body.solid, moved(body.T, offset * direction))
        if lowest(there, T_world_base) < 0.0003 and direction @ up < 0.5:
            return None
        here = deepest(there, others, least=allowed, enough=enough) - allowed
        worst = max(worst, here)
        if best is not None and worst >= best.depth:
            return None
        if worst > _BLOCKED:
            break
        lifted = [Body(body.solid, moved(there.T, lift * up)) for lift in _LIFTS]
        if here <= 0 and all(is_free(b, others, allowed) for b in lifted):
            return Way(offset * direction, worst)
    return Way(_OFFSETS[-1] * direction, worst + 0.05)


def lowest(body: Body, T_world_base: Transform) -> float:
    """Height of a body's lowest point over the table, metres."""
    return float(apply(T_world_base @ body.T, body.solid.samples)[:, 2].min())


def changes(before: Mapping[str, Transform], goals: Mapping[str, Transform]) -> list[str]:
    """Parts that have to be put somewhere (else) to get from one state to another, in order."""
    again = [n for n in before if n in goals and differs(before[n], goals[n])]
    return [*again, *(n for n in goals if n not in before)]


def differs(T_a: Transform, T_b: Transform) -> bool:
    """Whether two poses are told apart: by a millimetre or a degree."""
    far = float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3])) > 0.001
    return far or float(np.abs(T_a[:3, :3] - T_b[:3, :3]).max()) > 0.02


def all_ways(
    assembly: Assembly,
    solids: Mapping[str, Solid],
    targets: Mapping[int, Mapping[str, Transform]],
    T_world_base: Transform,
) -> Mapping[tuple[int, str], Way]:
    """The way of every part into every state: by state index and part name.

    Args:
        assembly: the states.
        solids: of all parts.
        targets: T_base_part of each state by index.
        T_world_base: where the base stands.
    """
    found: dict[tuple[int, str], Way] = {}
    for state in assembly.states:
        if state.index == 0:
            continue
        before = dict(targets[state.index - 1 if state.after is None else state.after])
        goals = targets[state.index]
        there = {n: T for n, T in before.items() if n in goals and not differs(T, goals[n])}
        for name in changes(before, goals):
            others = [Body(solids[n], T) for n, T in there.items()]
            body = Body(solids[name], goals[name])
            candidates = _candidates(assembly, name, goals[name], T_world_base)
            found[state.index, name] = find_way(body, others, candidates, T_world_base)
            there[name] = goals[name]
    return found


def _candidates(
    assembly: Assembly, name: str, T_base_part: Transform, T_world_base: Transform
) -> list[Vector]:
    """Directions worth trying: the joint's, up, the axes of the part and of the base."""
    up = T_world_base[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    joint = next((s.joints[name] for s in assembly.states if name in s.joints), None)
    first = [up]
    if joint is not None and joint.kind != "ball":
        first = sorted((joint.axis, -joint.axis), key=lambda axis: -float(axis @ up)) + first
    axes = [s * a for a in (*T_base_part[:3, :3].T, *np.eye(3)) for s in (1.0, -1.0)]
    rest = sorted(axes, key=lambda axis: -float(axis @ up))
    tilted = [(a + up) / np.linalg.norm(a + up) for a in axes if abs(float(a @ up)) < 0.5]
    unique: list[Vector] = []
    for axis in [*first, *rest, *tilted]:
        if all(float(axis @ other) < 0.999 for other in unique):
            unique.append(axis)
    return unique
