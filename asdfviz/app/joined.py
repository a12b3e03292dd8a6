"""Where the state has joined parts, by those that stand: in one frame or along a range. Pure.

A part that can move in its joint goes where it was last seen in it, before or within the range, else
after it.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
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
    """What is known of all frames, by place; asked only where it is needed."""

    assembly: Assembly
    count: int
    """Places there are."""
    state: Callable[[int], State | None]
    """None where the state is not known."""
    poses: Callable[[int], Poses]
    """Those that tell where others are: none that followed from others."""
    known: Callable[[int], Collection[str]]
    """The parts that may have one, for less than asking for the poses takes."""
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
        states = (self.state(place) for place in range(span[0], span[1] + 1))
        if any(state is not None and state.joints for state in states):
            self._look_back(span[0])
        found: dict[int, dict[str, Transform]] = {}
        for place in range(span[0], span[1] + 1):
            standing = self._standing(place)
            if standing is None:
                continue
            state, T_camera_base = standing
            self._see(place, T_camera_base, state.joints)
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
        stateless = sum(self.state(place) is None for place in places)
        joining = [place for place in places if self._joining(place) is not None]
        unposed = sum(self._standing(place) is None for place in joining)
        return stateless, len(places) - stateless - len(joining), unposed

    def _look_back(self, first: int) -> None:
        """See each part in its joint where it was there last before a place, or else soonest after."""
        missing = {name for state in self.assembly.states for name in state.joints}
        seen: list[tuple[int, Transform, set[str]]] = []
        for place in (*range(first - 1, -1, -1), *range(first, self.count)):
            if not missing:
                break
            state = self.state(place)
            if state is None or not (missing & state.joints.keys()).intersection(self.known(place)):
                continue
            standing = self._standing(place)
            here = set[str]() if standing is None else self._in_joints(place, *standing) & missing
            if standing is not None and here:
                seen.append((place, standing[1], here))
                missing -= here
        for place, T_camera_base, here in reversed(seen):
            self._see(place, T_camera_base, here)

    def _in_joints(self, place: int, state: State, T_camera_base: Transform) -> set[str]:
        """The parts that are where their joints allow it."""
        own, T_base_camera = self.poses(place), inverse(T_camera_base)
        return {
            name
            for name, joint in state.joints.items()
            if name in own
            and self.joints.nearest(name, T_base_camera @ own[name], state.T_base_part[name], joint)
            is not None
        }

    def _joining(self, place: int) -> State | None:
        """The state, if it joins anything to the base."""
        state = self.state(place)
        return state if state is not None and len(state.attached) > 1 else None

    def _standing(self, place: int) -> tuple[State, Transform] | None:
        """The state, if it joins anything, and T_camera_base, if that is known."""
        state = self._joining(place)
        base = None if state is None else base_by_group(self.assembly, state, self.poses(place))
        return None if state is None or base is None else (state, base)

    def _see(self, place: int, T_camera_base: Transform, names: Collection[str]) -> None:
        own = self.poses(place)
        seen = {n: PoseEstimate(n, own[n], 1.0, "annotated") for n in names if n in own}
        self.joints.see(T_camera_base, seen)
