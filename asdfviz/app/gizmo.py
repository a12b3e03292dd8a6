"""The gizmo of one browser tab: arrows or arcs at the selected part, and what dragging them asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from asdfviz.annotate.edits import gizmo_pose, pose_from_gizmo
from asdfviz.app import actions as act
from asdfviz.app.drawings import T_from_wxyz
from asdfviz.app.handles import move, put
from asdfviz.app.snapshot import Snapshot
from asdfviz.app.workspace import Workspace
from asdfviz.geometry.shapes import Transform

GIZMO_PX = 90.0
GIZMO_REACH = 0.2
"""In AR the gizmo hangs at this share of the part's distance, before every mesh that could catch its
drags. Scaling about the camera's centre changes nothing of what is seen."""


@dataclass(frozen=True, slots=True, eq=False)
class Drag:
    """A part while it is dragged."""

    part: str
    T_camera_part: Transform
    place: int
    """Of the frame in which the drag was begun, which may have gone since."""


class Gizmo:
    """The gizmo of one browser tab."""

    def __init__(
        self,
        scene: Any,
        workspace: Workspace,
        emit: Callable[[act.Action], None],
        parts: Mapping[str, Any],
    ) -> None:
        """Get ready; viser's gizmo is made when it is first wanted.

        Args:
            scene: viser's.
            workspace: for the parts' middles.
            emit: takes what a drag asks for.
            parts: handles of the parts' frames, by name, which follow the hand.
        """
        self._scene = scene
        self._workspace = workspace
        self._emit = emit
        self._parts = parts
        self._handle: Any = None
        self._reach = 1.0
        self._held: str | None = None
        self._place = 0
        self.dragged: Drag | None = None
        """What is held in the hand."""

    def apply(self, snap: Snapshot) -> None:
        """Hang at the selected part of a snapshot, unless a hand holds the gizmo."""
        self._place = snap.view.place
        part = snap.view.selected
        shown = snap.poses.get(part) if part else None
        mode = snap.view.gizmo
        wanted = shown is not None and mode != "off" and not snap.view.playing
        if self.dragged is not None:
            return
        if wanted and self._handle is None:
            self._make()
        if self._handle is None:
            return
        self._held = part if wanted else None
        if part is not None and shown is not None and wanted:
            centre = self._workspace.assembly.parts[part].middle
            self._reach = GIZMO_REACH if snap.view.mode == "ar" else 1.0
            T_camera_gizmo = gizmo_pose(shown.T_camera_part, centre)
            T_camera_gizmo[:3, 3] *= self._reach
            move(self._handle, T_camera_gizmo)
            # Not both: from straight ahead an arc lies edge-on over an arrow and would catch its drag.
            put(self._handle, "disable_axes", mode != "move")
            put(self._handle, "disable_sliders", mode != "move")
            put(self._handle, "disable_rotations", mode != "turn")
        put(self._handle, "visible", wanted)

    def _make(self) -> None:
        self._handle = self._scene.add_transform_controls(
            "/gizmo", scale=GIZMO_PX, fixed=True, depth_test=False, line_width=3.0
        )

        async def drag(event: Any) -> None:
            if self._held is not None and self._held in self._parts:
                self._drag(self._held, event)

        self._handle.on_update(drag)

    def _drag(self, part: str, event: Any) -> None:
        drag = self.dragged
        if drag is None or drag.place == self._place:
            centre = self._workspace.assembly.parts[part].middle
            T_camera_gizmo = T_from_wxyz(event.target.wxyz, event.target.position / self._reach)
            drag = Drag(part, pose_from_gizmo(T_camera_gizmo, centre), self._place)
            move(self._parts[part], drag.T_camera_part)
        # Otherwise another frame is shown: what the hand does over it says nothing of the first.
        done = event.phase == "end"
        self.dragged = None if done else drag
        if event.phase != "start":
            self._emit(act.MovePart(drag.part, drag.T_camera_part, drag.place, done))
