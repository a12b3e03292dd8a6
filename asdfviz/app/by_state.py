"""Joined parts go where the state has them, once one of them stands: the assembly's share of the work.

A part that can move in its joint goes where it was last seen in it. What was placed so gives way
when it is asked for again, as after the base was moved; what a person set stays.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass

from asdfviz.annotate.records import BY_STATE
from asdfviz.app.desk import Desk, Done
from asdfviz.app.history import NAMED, range_in_words
from asdfviz.app.truths import drawn_truth
from asdfviz.datatypes import Assembly, PoseEstimate, State
from asdfviz.errors import AnnotationError
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


def can_place(assembly: Assembly, state: State | None, poses: Poses, part: str) -> bool:
    """Whether the state tells where a part is, by others that stand."""
    if state is None or part not in state.attached:
        return False
    others = {name: T for name, T in poses.items() if name != part}
    return base_by_group(assembly, state, others) is not None


def place_one(desk: Desk) -> Done | None:
    """Put the selected part where the state of the frame shown has it; None where that says nothing."""
    shown = desk.workspace.poses(desk.view.place, desk.view.base)
    poses = {name: pose.T_camera_part for name, pose in shown.items()}
    state = desk.workspace.state(desk.view.place, desk.view.base)
    if not can_place(desk.workspace.assembly, state, poses, desk.part):
        return None
    only = (desk.view.place, desk.view.place)
    # A base that is to be put anew does not tell where it is; any other part tells of its joint.
    told = desk.part if desk.part == desk.workspace.assembly.base else None
    group = _Group.at(desk, only, without=told)
    found = group.placed(only, lambda _frame, name: name == desk.part)
    return _kept(desk, found, desk.part, f"frame {desk.frame}") if found else None


def place_joined(desk: Desk) -> Done:
    """Put every joined part without a pose where the state has it.

    In the frame shown, in the marked range, or in the one that the state was just set for.

    Raises:
        AnnotationError: there is none to put anywhere; the message says why.
    """
    said = desk.workspace.store.said()
    span = desk.view.joined
    group = _Group.at(desk, span)

    def is_free(frame: int, name: str) -> bool:
        is_gone = said.get((frame, name), ("", ""))[0] == "remove_pose"
        return not is_gone and name not in group.poses.get(frame, {})

    found = group.placed(span, is_free)
    where = range_in_words(*(desk.workspace.indices[place] for place in span))
    if not found:
        raise AnnotationError(_why_none(desk, where))
    names = list(dict.fromkeys(name for poses in found.values() for name in poses))
    who = " and ".join(names) if len(names) <= NAMED else f"{len(names)} joined parts"
    return _kept(desk, found, who, where)


def _kept(desk: Desk, found: Mapping[int, Poses], who: str, where: str) -> Done:
    store = desk.workspace.store
    with store.transaction():
        desk.begin()
        store.set_frames(found, provenance=BY_STATE, group=desk.group)
    return Done(f"{who} placed by the state in {where}", desk.view.place)


def _why_none(desk: Desk, where: str) -> str:
    assembly, view = desk.workspace.assembly, desk.view
    state = desk.workspace.state(view.place, view.base)
    if state is None:
        return (
            f"the state of frame {desk.frame} is not known: set it, then joined parts can be placed"
        )
    if len(state.attached) < 2:
        return f"in the state {state.name} nothing is joined to {assembly.base}"
    shown = desk.workspace.poses(view.place, view.base)
    poses = {name: pose.T_camera_part for name, pose in shown.items()}
    if base_by_group(assembly, state, poses) is None:
        return (
            f"no pose tells where the others are in frame {desk.frame}: place {assembly.base} first"
        )
    return f"every part that is joined in {where} has a pose, or is said not to be there"


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """The drawn poses of all frames, and what they tell of the joints."""

    desk: Desk
    poses: Mapping[int, Poses]
    """By frame number, without those that were placed by the state."""
    joints: JointPlaces

    @classmethod
    def at(cls, desk: Desk, span: tuple[int, int], *, without: str | None = None) -> _Group:
        """What is known at the places of a span, of joints also before it, or else after it."""
        assembly, view = desk.workspace.assembly, desk.view
        said = desk.workspace.store.said()
        poses = {
            frame: {
                name: T
                for name, T in known.T_camera_part.items()
                if said.get((frame, name)) != ("pose", BY_STATE)
                and (frame, name) != (desk.frame, without)
            }
            for frame, known in drawn_truth(desk.workspace, view.base).items()
        }
        group = cls(desk, poses, JointPlaces(assembly))
        movable = {name for state in assembly.states for name in state.joints}
        first, last = span
        after = range(len(desk.workspace.indices) - 1, last, -1)
        group.look_back([*after, *range(first)], movable)
        return group

    def look_back(self, places: list[int], names: Collection[str]) -> None:
        """See each part in its joint where it was seen there last, in the order of the places."""
        missing = set(names)
        seen: list[tuple[int, set[str]]] = []
        for place in reversed(places):
            if not missing:
                break
            state = self._state(place)
            if state is None:
                continue
            here = missing & set(state.joints) & set(self._own(place))
            if here and self._base(place, state) is not None:
                seen.append((place, here))
                missing -= here
        for place, here in reversed(seen):
            self._see(place, here)

    def placed(
        self, span: tuple[int, int], is_free: Callable[[int, str], bool]
    ) -> dict[int, dict[str, Transform]]:
        """T_camera_part, by frame number, of joined parts that are free to be put somewhere."""
        found: dict[int, dict[str, Transform]] = {}
        for place, state, T_camera_base in self._standing(span):
            self._see(place, state.attached)
            frame = self.desk.workspace.indices[place]
            fresh = {
                name: orthonormalized(T_camera_base @ self.joints.last(name, state))
                for name in state.attached
                if is_free(frame, name)
            }
            if fresh:
                found[frame] = fresh
        return found

    def _standing(self, span: tuple[int, int]) -> Iterator[tuple[int, State, Transform]]:
        """Places at which the state joins parts, and it is known where the base is."""
        for place in range(span[0], span[1] + 1):
            state = self._state(place)
            if state is None or len(state.attached) < 2:
                continue
            T_camera_base = self._base(place, state)
            if T_camera_base is not None:
                yield place, state, T_camera_base

    def _see(self, place: int, names: Collection[str]) -> None:
        state, own = self._state(place), self._own(place)
        T_camera_base = None if state is None else self._base(place, state)
        if T_camera_base is not None:
            seen = {n: PoseEstimate(n, own[n], 1.0, "annotated") for n in names if n in own}
            self.joints.see(T_camera_base, seen)

    def _state(self, place: int) -> State | None:
        return self.desk.workspace.state(place, self.desk.view.base)

    def _base(self, place: int, state: State) -> Transform | None:
        return base_by_group(self.desk.workspace.assembly, state, self._own(place))

    def _own(self, place: int) -> Poses:
        return self.poses.get(self.desk.workspace.indices[place], {})
