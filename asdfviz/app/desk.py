"""What an edit needs to know and to leave behind: the frames, the selected part, the step of undo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from asdfviz.annotate.edits import moved_group
from asdfviz.app.actions import MovePart
from asdfviz.app.history import range_in_words
from asdfviz.app.items import ANNOTATION, Shown
from asdfviz.app.lanes import Lane
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError
from asdfviz.geometry.shapes import Transform, Vector

BURST = 0.8
"""Seconds: nudges that follow each other faster are undone as one ..."""
LONGEST_BURST = 1.5
"""... up to so many seconds after the first: nobody wants to lose a minute's work at once."""
_DEEDS = {
    "gizmo": "dragged",
    "keys": "moved",
    "copied": "copied",
    "placed": "placed",
    "fitted": "fitted",
}


class NothingLeft(AnnotationError):
    """There is nothing more to undo, to redo or to go to: no fault, only the end."""


@dataclass(frozen=True, slots=True)
class Burst:
    """Nudges in a row, which are one step for undo."""

    name: str = ""
    until: float = 0.0
    """Time (monotonic) up to which the next nudge still belongs to it."""

    end: float = 0.0
    """Time (monotonic) at which it is over however fast nudges come."""

    def joined(self, name: str, now: float) -> Burst:
        """This burst prolonged, or a new one where the last is over or was of something else."""
        if now < self.until and self.name.split("@")[0] == name:
            return replace(self, until=min(now + BURST, self.end))
        return Burst(f"{name}@{now:.6f}", now + BURST, now + LONGEST_BURST)


@dataclass(frozen=True, slots=True)
class Done:
    """What an edit did."""

    message: str
    place: int
    burst: Burst = Burst()
    state: int | None = None
    """The state that was set, if one was."""


@dataclass(frozen=True, slots=True)
class Desk:
    """Where an edit happens."""

    workspace: Workspace
    view: View
    group: str
    """What belongs to one step of undo."""

    @property
    def frame(self) -> int:
        """Number of the frame shown."""
        return self.workspace.indices[self.view.place]

    @property
    def span(self) -> tuple[int, int]:
        """Numbers of the first and last frame that a statement is for."""
        first, last = self.view.frames
        return self.workspace.indices[first], self.workspace.indices[last]

    @property
    def where(self) -> str:
        """The same in words."""
        return range_in_words(*self.span)

    @property
    def part(self) -> str:
        """The selected part."""
        if self.view.selected is None:
            raise AnnotationError("no part is selected: click one in the picture or in the list")
        return self.view.selected

    def pose(self) -> Transform:
        """Where the selected part is."""
        return self._pose(self.view.place, self.view.base)

    def _pose(self, place: int, base: str | None) -> Transform:
        found = self.workspace.poses(place, base).get(self.part)
        if found is None:
            raise AnnotationError(
                f"{self.part} has no pose in frame {self.workspace.indices[place]}: "
                "place it, or copy it from another"
            )
        return found.T_camera_part

    def begin(self) -> None:
        """Note what the corrections start from, once, as part of the first edit's step."""
        store = self.workspace.store
        if store.seed().kind == "none" and self.view.base is not None:
            store.set_seed(self.workspace.seed_of(self.view.base), group=self.group)

    def keep(self, T_camera_part: Transform, provenance: str) -> Done:
        """Say where the selected part is."""
        return self._keep({self.part: T_camera_part}, self.part, provenance)

    def move(self, part: str, T_camera_part: Transform, provenance: str) -> Done:
        """Move a part, and what is joined with it if it is to come along."""
        moved = carried(self.workspace, self.view, part=part, T_camera_part=T_camera_part)
        return self._keep(moved, part, provenance)

    def _keep(self, moved: Mapping[str, Transform], part: str, provenance: str) -> Done:
        self.begin()
        store = self.workspace.store
        store.set_poses(self.frame, moved, provenance=provenance, group=self.group)
        along = f" and {len(moved) - 1} joined with it" if len(moved) > 1 else ""
        said = f"{part}{along} {_DEEDS[provenance]} in frame {self.frame}"
        return Done(said, self.view.place)

    @property
    def base(self) -> str | None:
        """What is drawn where nothing was corrected: what corrections started from, once they have."""
        return self.workspace.base_of_seed() or self.view.base

    def lane(self) -> Lane:
        """Where the selected part has a pose, as it is drawn."""
        return self.workspace.lane(self.part, self.base)

    def pose_at(self, place: int) -> Transform:
        """Where it is at a place of its lane."""
        return self._pose(place, self.base)

    def centre(self) -> Vector:
        """What of the selected part stays in place when it turns, part frame."""
        return self.workspace.assembly.parts[self.part].middle


def carried(
    workspace: Workspace, view: View, *, part: str, T_camera_part: Transform
) -> dict[str, Transform]:
    """The new poses where a part is moved: its own, and those of what is joined if all move as one."""
    shown = workspace.poses(view.place, view.base)
    if not view.together or part not in shown:
        return {part: T_camera_part}
    poses = {name: pose.T_camera_part for name, pose in shown.items()}
    attached = workspace.attached(view.place, view.base)
    return moved_group(poses, part, T_camera_part, attached=attached)


def dragged(workspace: Workspace, view: View, drag: MovePart) -> dict[str, Shown]:
    """The poses to draw while a part is held: nothing of them is kept yet."""
    moved = carried(workspace, view, part=drag.part, T_camera_part=drag.T_camera_part)
    return {
        part: Shown(T_camera_part, ANNOTATION, "annotated") for part, T_camera_part in moved.items()
    }
