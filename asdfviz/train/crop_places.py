"""Places of scenes that are still empty: what the coming states join there, and what stood there before.

Whoever names things is also asked whether a part stands where a state would have it. What an empty place
shows, a hole or a flat of the base part, is none of the things that other crops show.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from asdfviz.data.scene_objects import SceneObject
from asdfviz.datatypes import Assembly, Part
from asdfviz.geometry.boxes import box_around, is_in_view, overlap
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Box, Intrinsics, Points, Transform
from asdfviz.geometry.transforms import apply
from asdfviz.pose.labels import Group, Subject
from asdfviz.state.fusion import neighbours

NEAREST = 0.05
"""What comes nearer to the camera than this, metres, is left out."""
SAME = 0.1
"""A like part whose box overlaps the place's by more than this stands in it, or may be taken to."""
OTHER = 0.5
"""Another part that overlaps it by more is what the place shows."""
LEAST_PX = 4.0
"""A place that is smaller in the picture shows nothing."""


class EmptyPlaces:
    """Finds them in the frames of one assembly."""

    def __init__(self, subject: Subject) -> None:
        self._subject, self._assembly = subject, subject.assembly
        self._wanted = _wanted(subject.assembly)

    def find(
        self,
        objects: Sequence[SceneObject],
        parts: Sequence[Part | None],
        groups: Sequence[Group],
        *,
        K: Intrinsics,
        size_wh: tuple[int, int],
    ) -> Iterator[tuple[Part, Transform]]:
        """Every part that a neighbour of a group's state has where none like it is, and T_camera_part.

        Args:
            objects: of the frame, hidden ones too.
            parts: of the assembly that they are; None: another thing.
            groups: of what is joined.
            K: of the frame.
            size_wh: likewise, pixels.
        """
        found = [(p, i.T_camera_object) for p, i in zip(parts, objects, strict=True) if p]
        boxes = [(part, self._box(part, T, K)) for part, T in found]
        seen = [(part, box) for part, box in boxes if box is not None]
        for state, place in held_bases(self._assembly, parts, groups):
            for part, T in self._places(state, objects[place].T_camera_object):
                box = self._box(part, T, K)
                if box is not None and _is_empty(part, box, seen, size_wh):
                    yield part, T

    def _places(self, state: str, T_camera_base: Transform) -> Iterator[tuple[Part, Transform]]:
        """The places that a state's neighbours have besides its own, T_camera_part."""
        for name, T_base_part in self._wanted[state]:
            yield self._assembly.parts[name], T_camera_base @ T_base_part

    def _box(self, part: Part, T_camera_part: Transform, K: Intrinsics) -> Box | None:
        return box_of(self._subject.hulls[part.name], T_camera_part, K)


def held_bases(
    assembly: Assembly, parts: Sequence[Part | None], groups: Sequence[Group]
) -> Iterator[tuple[str, int]]:
    """The state of every group that holds a base part, and the place of that among a frame's objects."""
    states = {state.name for state in assembly.states}
    for group in groups:
        for place in group.members or ():
            part = parts[place]
            if part is not None and part.name == assembly.base and group.state in states:
                yield group.state, place


def box_of(corners: Points, T_camera_part: Transform, K: Intrinsics) -> Box | None:
    """Around the corners of a part, pixels; None where they come too near to the camera."""
    seen = apply(T_camera_part, corners)
    return None if seen[:, 2].min() < NEAREST else box_around(project(seen, K))


def _wanted(assembly: Assembly) -> dict[str, list[tuple[str, Transform]]]:
    """What the neighbours of each state have in places that are not its own, each place once."""
    near = neighbours(assembly) > 0
    wanted: dict[str, list[tuple[str, Transform]]] = {}
    for own in assembly.states:
        found: dict[tuple[str, bytes], Transform] = {}
        for state in assembly.states:
            if near[own.index, state.index]:
                found |= {(p, T.tobytes()): T for p, T in state.T_base_part.items()}
        for part, T in own.T_base_part.items():
            found.pop((part, T.tobytes()), None)
        wanted[own.name] = [(part, T) for (part, _), T in found.items()]
    return wanted


def _is_empty(
    part: Part, box: Box, seen: Sequence[tuple[Part, Box]], size_wh: tuple[int, int]
) -> bool:
    """Whether the picture shows the place, and in it neither such a part nor mainly another."""
    if not is_in_view(box, size_wh) or float((box[2:] - box[:2]).min()) < LEAST_PX:
        return False
    return all(
        overlap(other, box) < (SAME if one.detector_class == part.detector_class else OTHER)
        for one, other in seen
    )
