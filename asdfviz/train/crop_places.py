"""Places of scenes that are still empty: what the coming states join there, and what stood there before.

Whoever names things is also asked whether a part stands where a state would have it. What an empty place
shows, a hole or a flat of the base part, is none of the things that other crops show.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from asdfviz.data.scene_objects import SceneObject
from asdfviz.datatypes import Assembly, Part
from asdfviz.geometry.boxes import box_around, is_in_view, overlap
from asdfviz.geometry.camera import project
from asdfviz.geometry.sampling import hull_corners
from asdfviz.geometry.shapes import Box, Intrinsics, Transform
from asdfviz.geometry.transforms import apply
from asdfviz.pose.labels import Group, part_of
from asdfviz.state.fusion import neighbours

NEAREST = 0.05
"""What comes nearer to the camera than this, metres, is left out."""
SAME = 0.1
"""A like part whose box overlaps the place's by more than this stands in it, or may be taken to."""
OTHER = 0.5
"""Another part that overlaps it by more is what the place shows."""
LEAST_PX = 4.0
"""A place that is smaller in the picture shows nothing."""


class _Seen(NamedTuple):
    part: Part
    box_xyxy: Box


class EmptyPlaces:
    """Finds them in the frames of one assembly."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly, self._near = assembly, neighbours(assembly) > 0
        self._base = assembly.base
        self._states = {state.name: state for state in assembly.states}
        self._corners = {n: hull_corners(p.mesh.vertices) for n, p in assembly.parts.items()}

    def find(
        self,
        objects: Sequence[SceneObject],
        groups: Sequence[Group],
        *,
        K: Intrinsics,
        size_wh: tuple[int, int],
    ) -> Iterator[tuple[Part, Transform]]:
        """Every part that a neighbour of a group's state has where none like it is, and T_camera_part.

        Args:
            objects: of the frame, hidden ones too.
            groups: of what is joined.
            K: of the frame.
            size_wh: likewise, pixels.
        """
        parts = [part_of(self._assembly, item) for item in objects]
        boxes = [
            None if part is None else self._box(part, item.T_camera_object, K)
            for part, item in zip(parts, objects, strict=True)
        ]
        pairs = zip(parts, boxes, strict=True)
        seen = [_Seen(part, box) for part, box in pairs if part is not None and box is not None]
        for group in groups:
            bases = [p for p in group.members or () if (q := parts[p]) and q.name == self._base]
            if not bases or group.state not in self._states:
                continue
            base = objects[bases[0]]
            for name, T_base_part in self._wanted(group.state):
                # The base part is the object, so its frame is the base's.
                T_camera_base, part = (base.T_camera_object, self._assembly.parts[name])
                T_camera_part = T_camera_base @ T_base_part
                box = self._box(part, T_camera_part, K)
                if box is not None and self._is_empty(part, box, seen, size_wh):
                    yield part, T_camera_part

    def _wanted(self, name: str) -> list[tuple[str, Transform]]:
        """What the neighbours of a state have in places that are not its own, each place once."""
        own = self._states[name]
        found: dict[tuple[str, bytes], Transform] = {}
        for state in self._assembly.states:
            if self._near[own.index, state.index]:
                found |= {(p, T.tobytes()): T for p, T in state.T_base_part.items()}
        for part, T in own.T_base_part.items():
            found.pop((part, T.tobytes()), None)
        return [(part, T) for (part, _), T in found.items()]

    def _box(self, part: Part, T_camera_part: Transform, K: Intrinsics) -> Box | None:
        corners = apply(T_camera_part, self._corners[part.name])
        return None if corners[:, 2].min() < NEAREST else box_around(project(corners, K))

    @staticmethod
    def _is_empty(part: Part, box: Box, seen: Sequence[_Seen], size_wh: tuple[int, int]) -> bool:
        """Whether the picture shows the place, and in it neither such a part nor mainly another."""
        shows = is_in_view(box, size_wh)
        if not shows or float((box[2:] - box[:2]).min()) < LEAST_PX:
            return False
        return all(
            overlap(one.box_xyxy, box)
            < (SAME if one.part.detector_class == part.detector_class else OTHER)
            for one in seen
        )
