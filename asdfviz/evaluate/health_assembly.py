"""Looks an assembly over by itself: sizes of its parts, where its states put them, what looks alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from collections.abc import Sequence as Rows
from dataclasses import replace
from itertools import combinations
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, PoseEstimate, State
from asdfviz.errors import some
from asdfviz.evaluate.health_camera import check_offsets, check_origins, check_relative_sizes
from asdfviz.evaluate.health_report import AssemblyReport, Finding
from asdfviz.evaluate.health_symmetry import check_symmetries
from asdfviz.evaluate.pose_errors import nearest_points
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply, inverse
from asdfviz.state.base_turns import equal_bases
from asdfviz.state.joints import off_place
from asdfviz.state.twins import twin_groups
from asdfviz.synth.penetration import Solid, penetration, solid_of, surface_distance

SMALLEST, LARGEST = 10e-3, 0.8
"""Of the largest part, metres: what is handled by hand and filmed from where all of it is seen."""
DEEP, DEEP_SHARE = 1e-3, 0.03
"""Parts may stand in each other so far, metres, and by such a share of the smaller one."""
FLOATS = 5e-3
"""A part whose surface is farther than this from all others, metres, is joined to nothing."""
ALIKE, ALIKE_DEG = 2e-3, 5.0
"""States that differ by less than this in every part, metres and degrees, are one."""
MEASURED = 40
"""Points within another part whose depth is measured."""

PROBES = 100
"""Points of a part whose distance from another's triangles is measured: those nearest to its samples."""

Progress: TypeAlias = Callable[[int, int, str], None]
Pair: TypeAlias = tuple[str, str]


def check_assembly_alone(assembly: Assembly, *, progress: Progress | None = None) -> AssemblyReport:
    """Look an assembly over; no recording is needed.

    Args:
        assembly: what to look at.
        progress: told how far it is: done, in all, and what is looked at.
    """
    tell: Progress = progress or (lambda done, total, what: None)
    steps = len(assembly.states) + 2
    findings = [*_check_size(assembly), *check_relative_sizes(assembly)]
    findings += [*check_offsets(assembly), *check_origins(assembly)]
    places = _Places(assembly)
    for done, state in enumerate(assembly.states):
        tell(done, steps, f"state {state.name}")
        places.look(state)
    findings += [*places.overlaps(), *places.floating(), *check_alike(assembly)]
    tell(steps - 1, steps, "symmetries")
    findings += check_symmetries(assembly)
    tell(steps, steps, "")
    return AssemblyReport(
        assembly=assembly.name,
        path=assembly.path,
        parts=len(assembly.parts),
        states=len(assembly.states),
        findings=tuple(findings),
    )


def _check_size(assembly: Assembly) -> Iterator[Finding]:
    sizes = {name: part.diameter for name, part in assembly.parts.items()}
    largest = max(sizes, key=lambda name: sizes[name])
    if not SMALLEST <= sizes[largest] <= LARGEST:
        other = "cm, m or inches" if sizes[largest] < SMALLEST else "mm"
        yield Finding(
            "mesh_unit",
            "warning",
            f"The largest part, {largest}, is {1e3 * sizes[largest]:.3g} mm across. If its mesh is "
            f"in {other}, set 'unit' in assembly.yaml (mm, cm or m), or scale the mesh.",
            sizes[largest],
        )


class _Places:
    """What is found of where the states put the parts, each pair of places looked at once."""

    def __init__(self, assembly: Assembly) -> None:
        self._solids = {name: solid_of(part.mesh) for name, part in assembly.parts.items()}
        self._assembly = assembly
        self._depths: dict[tuple[str, str, bytes], float] = {}
        self._gaps: dict[tuple[str, str, bytes], float] = {}
        self._deep: dict[Pair, dict[str, float]] = {}
        self._afloat: dict[tuple[str, ...], dict[str, float]] = {}

    def look(self, state: State) -> None:
        """Measure every pair of parts of a state."""
        parts, near = self._assembly.parts, list[Pair]()
        gaps: dict[Pair, float] = {}
        for a, b in combinations(state.T_base_part, 2):
            T_a_b = inverse(state.T_base_part[a]) @ state.T_base_part[b]
            key = (a, b, np.round(T_a_b, 6).tobytes())
            if key not in self._depths:
                self._depths[key], self._gaps[key] = _between(
                    self._solids[b], self._solids[a], T_a_b
                )
            smaller = min(parts[a].diameter, parts[b].diameter)
            if self._depths[key] > max(DEEP, DEEP_SHARE * smaller):
                self._deep.setdefault((a, b), {})[state.name] = self._depths[key]
            gaps[a, b] = self._gaps[key]
            if gaps[a, b] <= FLOATS:
                near.append((a, b))
        for group in _groups(tuple(state.T_base_part), near):
            if self._assembly.base not in group:
                out = [gap for pair, gap in gaps.items() if len(set(pair) & set(group)) == 1]
                self._afloat.setdefault(group, {})[state.name] = min(out)

    def overlaps(self) -> Iterator[Finding]:
        """Name the parts that stand in each other."""
        for (a, b), states in self._deep.items():
            deepest = max(states.values())
            yield Finding(
                "overlap",
                "warning",
                f"{a} and {b} stand {1e3 * deepest:.1f} mm deep in each other in {some(states)}. "
                "Check their 't' and 'R' (row by row, part to base frame), and the meshes' units.",
                deepest,
            )

    def floating(self) -> Iterator[Finding]:
        """Name the parts that touch nothing that is joined to the base."""
        for group, states in self._afloat.items():
            farthest = max(states.values())
            one = len(group) == 1
            yield Finding(
                "floating",
                "warning",
                f"{' and '.join(group)} {'is' if one else 'are'} {1e3 * farthest:.1f} mm away from "
                f"every other part in {some(states)}. Check {'its' if one else 'their'} 't' (in the "
                "file's unit, of the origin of the part's mesh) and 'R', or join what lies between.",
                farthest,
            )


def _between(a: Solid, b: Solid, T_b_a: Transform) -> tuple[float, float]:
    """How deep two solids stand in each other, and how far they are apart if they do not, metres."""
    corners = apply(T_b_a, a.samples)
    low, high = corners.min(axis=0), corners.max(axis=0)
    beyond = np.maximum(np.maximum(b.low - high, low - b.high), 0.0)
    boxes = float(np.linalg.norm(beyond))
    if boxes > FLOATS:
        return 0.0, boxes
    deep = penetration(a, b, T_b_a, most=MEASURED)
    return deep, 0.0 if deep > 0 else _gap(a, b, T_b_a)


def _gap(a: Solid, b: Solid, T_b_a: Transform) -> float:
    """Distance of two solids; where it is no more than FLOATS, at most what it is between samples."""
    points = apply(T_b_a, a.samples)
    apart, nearest = nearest_points(b.samples).query(points)
    if apart.min() <= FLOATS:
        return float(apart.min())
    likeliest = np.argsort(apart)[:PROBES]
    back = apply(inverse(T_b_a), b.samples[np.unique(nearest[likeliest])])
    to_b = surface_distance(points[likeliest], b).min()
    return float(min(to_b, surface_distance(back, a).min()))


def _groups(names: tuple[str, ...], near: Rows[Pair]) -> list[tuple[str, ...]]:
    """The parts in groups that hang together."""
    group = {name: {name} for name in names}
    for a, b in near:
        if group[a] is not group[b]:
            group[a] |= group[b]
            for name in group[b]:
                group[name] = group[a]
    return list(dict.fromkeys(tuple(n for n in names if n in group[name]) for name in names))


def check_alike(assembly: Assembly) -> Iterator[Finding]:
    """Look for states that put the same parts in the same places."""
    kinds = {name: names[0] for names in twin_groups(assembly) for name in names}
    for a, b in combinations(assembly.states, 2):
        if any(
            _places_alike(turned, other, assembly, kinds)
            for one, other in ((a, b), (b, a))
            for turned in _base_turned(one, assembly)
        ):
            yield Finding(
                "same_states",
                "warning",
                f"{a.name} and {b.name} put the same parts in the same places (symmetries, joints and "
                "copies of a part taken into account): nothing tells them apart. Take one of them "
                "out, or change what the second one's 'poses' say.",
            )


def _base_turned(state: State, assembly: Assembly) -> Iterator[State]:
    """The state as it looks from every pose of the base that looks like its own, that one first."""
    poses = {name: PoseEstimate(name, T, 1.0, "pnp") for name, T in state.T_base_part.items()}
    for T in equal_bases(np.eye(4), poses, assembly):
        yield replace(
            state,
            T_base_part={n: inverse(T) @ T_part for n, T_part in state.T_base_part.items()},
        )


def _places_alike(a: State, b: State, assembly: Assembly, kinds: Mapping[str, str]) -> bool:
    """Whether all that the first has joined is where the second's joints let it be."""
    if sorted(kinds[n] for n in a.T_base_part) != sorted(kinds[n] for n in b.T_base_part):
        return False
    return all(
        any(
            off_place(T_base_part, assembly.parts[twin], b).within(ALIKE, ALIKE_DEG)
            for twin in b.T_base_part
            if kinds[twin] == kinds[name]
        )
        for name, T_base_part in a.T_base_part.items()
    )
