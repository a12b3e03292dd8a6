"""Where the state has joined parts, by those that stand: in one frame or along a range. Pure.

A part that can move in its joint goes where it was last seen in it, before or within the range, else
after it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from asdfviz.datatypes import Assembly, PoseEstimate, State
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse, orthonormalized
from asdfviz.state.joint_places import JointPlaces

Poses = Mapping[str, Transform]
"""T_camera_part by part."""


def base_by_group(assembly: Assembly, state: State, poses: Poses) -> Transform | None:
    """T_camera_base, by the base's own pose or else by a part that is joined to it and cannot move."""
    if assembly.base in poses:
        return poses[assembly.base]
    for name, T_base_part in state.T_base_part.items():
        # A part that looks the same when turned may have been placed in any of those ways.
        is_told = name not in state.joints and not assembly.parts[name].symmetries.is_symmetric
        if is_told and name in poses:
            return poses[name] @ inverse(T_base_part)
    return None


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """What is known of all frames, by place."""

    assembly: Assembly
    states: Sequence[State | None]
    """None where the state is not known."""
    poses: Sequence[Poses]
    """Those that tell where others are: none that followed from others."""
    joints: JointPlaces = field(init=False)

    def __post_init__(self) -> None:
        """Begin with joints of which nothing was seen."""
        object.__setattr__(self, "joints", JointPlaces(self.assembly))

    def placed(
        self, span: tuple[int, int], is_free: Callable[[int, str], bool]
    ) -> dict[int, dict[str, Transform]]:
        """T_camera_part, by place, of joined parts that are free to be put somewhere.

        Args:
            span: the first and the last place.
            is_free: asked of a place and a part.
        """
        self._look_back(span[0])
        found: dict[int, dict[str, Transform]] = {}
        for place, state, T_camera_base in self._standing(span):
            self._see(place, state.joints)
            fresh = {
                name: orthonormalized(T_camera_base @ self.joints.last(name, state))
                for name in state.attached
                if is_free(place, name)
            }
            if fresh:
                found[place] = fresh
        return found

    def unknown(self, span: tuple[int, int]) -> tuple[int, int, int]:
        """Of the places of a span: how many have no state, join nothing, have nothing that stands."""
        places = range(span[0], span[1] + 1)
        known = [(self.states[place], place) for place in places]
        stateless = sum(state is None for state, _ in known)
        joining = [(s, place) for s, place in known if s is not None and len(s.attached) > 1]
        unposed = sum(self._base(place, state) is None for state, place in joining)
        return stateless, len(known) - stateless - len(joining), unposed

    def _look_back(self, first: int) -> None:
        """See each part in its joint where it was there last before a place, or else soonest after."""
        missing = {name for state in self.assembly.states for name in state.joints}
        seen: list[tuple[int, set[str]]] = []
        for place in (*range(first - 1, -1, -1), *range(first, len(self.states))):
            if not missing:
                break
            here = {name for name in missing if self._is_in_joint(place, name)}
            if here:
                seen.append((place, here))
                missing -= here
        for place, here in reversed(seen):
            self._see(place, here)

    def _is_in_joint(self, place: int, name: str) -> bool:
        state, own = self.states[place], self.poses[place]
        if state is None or name not in state.joints or name not in own:
            return False
        T_camera_base = self._base(place, state)
        if T_camera_base is None:
            return False
        T_base_part = inverse(T_camera_base) @ own[name]
        nominal, joint = state.T_base_part[name], state.joints[name]
        return self.joints.nearest(name, T_base_part, nominal, joint) is not None

    def _standing(self, span: tuple[int, int]) -> Iterator[tuple[int, State, Transform]]:
        """Places at which the state joins parts, and it is known where the base is."""
        for place in range(span[0], span[1] + 1):
            state = self.states[place]
            if state is None or len(state.attached) < 2:
                continue
            T_camera_base = self._base(place, state)
            if T_camera_base is not None:
                yield place, state, T_camera_base

    def _see(self, place: int, names: Collection[str]) -> None:
        state, own = self.states[place], self.poses[place]
        T_camera_base = None if state is None else self._base(place, state)
        if T_camera_base is not None:
            seen = {n: PoseEstimate(n, own[n], 1.0, "annotated") for n in names if n in own}
            self.joints.see(T_camera_base, seen)

    def _base(self, place: int, state: State) -> Transform | None:
        return base_by_group(self.assembly, state, self.poses[place])
