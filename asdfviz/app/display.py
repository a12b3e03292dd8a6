"""Shows one browser tab its view: picture, meshes and panel in one message, the camera, coming frames."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from typing import Any

from asdfviz.app import actions as act
from asdfviz.app import camera, hotkeys
from asdfviz.app.notes import Notes
from asdfviz.app.page import Page
from asdfviz.app.playback import DECODE_ROUNDS, SLOTS, wait_until_shown
from asdfviz.app.scene import Scene
from asdfviz.app.snapshot import Snapshot
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import Frame
from asdfviz.errors import InputError
from asdfviz.methods.spec import BrokenMethod, MethodSpec

_AHEAD = 12
"""Frames that are decoded before they are needed."""


class Display:
    """What one browser tab is shown."""

    def __init__(
        self,
        client: Any,
        workspace: Workspace,
        emit: Callable[[act.Action], None],
        methods: Mapping[str, MethodSpec | BrokenMethod],
    ) -> None:
        self._client = client
        self._workspace = workspace
        self._placed = (-1, b"")
        self._unreadable: int | None = None
        self._notes = Notes(client)
        with client.atomic():
            self._page = Page(
                client.gui,
                methods,
                emit,
                opened=workspace.opened,
                path=workspace.frames.path,
            )
            self._scene = Scene(client, workspace, emit)
            hotkeys.register(client.gui, workspace.assembly, emit)

    @property
    def is_dragging(self) -> bool:
        """Whether a gizmo is held."""
        return self._scene.gizmo.dragged is not None

    def show(self, snap: Snapshot) -> bool:
        """Show a snapshot; True where the page has answered meanwhile, so that it keeps up."""
        place, frame = snap.view.place, snap.frame
        is_new = frame is not None and self._scene.load(place, frame)
        if is_new:
            # The page decodes it meanwhile, so that picture and poses change together.
            for _ in range(DECODE_ROUNDS):
                wait_until_shown(self._client)
        with self._client.atomic():
            self._scene.apply(snap)
            self._page.show(snap)
        self._place_camera(snap)
        if snap.view.playing:
            self._send_ahead(snap.view)
        return is_new

    def frame(self, place: int) -> Frame | None:
        """The frame at a place; None, told once, where it cannot be read."""
        self._workspace.frames.wish(range(place + 1, place + _AHEAD))
        try:
            return self._workspace.frames[place]
        except InputError as error:
            if self._unreadable != place:
                self._unreadable = place
                number = self._workspace.indices[place]
                self.tell(f"Frame {number} cannot be read", str(error), color="red")
            return None

    def tell(self, title: str, body: str, *, color: Any) -> None:
        """Show a note; a red one, about a problem, stands longer."""
        self._notes.tell(title, body, color=color)

    def _send_ahead(self, view: View) -> None:
        coming = range(view.place + 1, min(view.place + SLOTS, len(self._workspace.indices)))
        ready: dict[int, Any] = {}
        for place in coming:
            with contextlib.suppress(InputError):
                frame = self._workspace.frames.peek(place)
                if frame is not None:
                    ready[place] = frame.rgb
        self._scene.ring.send_ahead(ready)

    def _place_camera(self, snap: Snapshot) -> None:
        is_ar = snap.view.mode == "ar"
        placed = (snap.view.turns, snap.facts.K.tobytes() if is_ar else b"")
        if self._placed == placed:
            return
        self._placed = placed
        if is_ar:
            camera.place_ar(self._client, snap.view, snap.facts)
        else:
            camera.place_free(self._client, self._scene.middle(snap))
