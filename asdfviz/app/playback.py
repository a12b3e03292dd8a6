"""Pictures in time: a ring of image planes, and waiting until the page has shown one.

The page decodes an image off its main loop and drops it when the next arrives, so frames sent too
fast are never seen. Here coming frames are sent ahead into hidden planes; showing one is a flip of
visibility in the same message as the poses, and the next is only sent when the page has answered.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from typing import Any

from asdfviz.app.ar import Plane
from asdfviz.geometry.shapes import Rgb

SLOTS = 5
JPEG_QUALITY = 88
DECODE_ROUNDS = 2
"""Answers of the page to wait for until a picture that was just sent is decoded."""
ACK_SECONDS = 3.0
"""Longest wait for a page; one that hangs must not stop the session."""


class Ring:
    """A few image planes in one place, of which one is visible."""

    def __init__(self, scene: Any, name: str) -> None:
        self._scene = scene
        self._name = name
        self._plane: Plane | None = None
        self._handles: list[Any] = []
        self._places: list[int] = []
        self._shown = 0

    @property
    def places(self) -> frozenset[int]:
        """The frames whose pictures the page has."""
        return frozenset(self._places)

    def load(self, place: int, rgb: Rgb, plane: Plane) -> bool:
        """Send a frame's picture into a hidden plane; False where it is there already."""
        if self._plane != plane or not self._handles:
            self._make(place, rgb, plane)
            return True
        if place in self._places:
            return False
        slot = (self._shown + 1) % SLOTS
        self._handles[slot].image = rgb
        self._places[slot] = place
        return True

    def show(self, place: int) -> None:
        """Make the plane of a loaded frame the visible one."""
        target = self._places.index(place)
        if target != self._shown:
            self._handles[target].visible = True
            self._handles[self._shown].visible = False
            self._shown = target

    def send_ahead(self, frames: Mapping[int, Rgb]) -> None:
        """Put coming frames into hidden planes, keeping those that are there already."""
        wanted = [place for place in frames if place not in self._places]
        kept = {self._shown} | {i for i, place in enumerate(self._places) if place in frames}
        free = [slot for slot in range(len(self._handles)) if slot not in kept]
        for place, slot in zip(wanted, free, strict=False):
            self._handles[slot].image = frames[place]
            self._places[slot] = place

    def set_visible(self, *, visible: bool) -> None:
        """Show or hide the picture as a whole."""
        if self._handles:
            self._handles[self._shown].visible = visible

    def _make(self, place: int, rgb: Rgb, plane: Plane) -> None:
        for handle in self._handles:
            handle.remove()
        self._plane = plane
        self._shown = 0
        self._places = [place] + [-1] * (SLOTS - 1)
        self._handles = [
            self._scene.add_image(
                f"{self._name}/{slot}",
                rgb if slot == 0 else rgb[:2, :2],
                render_width=plane.width,
                render_height=plane.height,
                format="jpeg",
                jpeg_quality=JPEG_QUALITY,
                cast_shadow=False,
                receive_shadow=False,
                position=plane.position,
                visible=slot == 0,
            )
            for slot in range(SLOTS)
        ]


def wait_until_shown(client: Any) -> None:
    """Wait for the page to have worked off what was sent, but not for ever.

    Reading the page's local storage is the one public round trip that viser has. An error is an
    answer too: a page that may not use its storage, or one that has just gone.
    """
    with contextlib.suppress(RuntimeError, TimeoutError):
        client.local_storage.get_item("asdfviz-ack", timeout=ACK_SECONDS)


class Pace:
    """Says when the next frame is due."""

    def __init__(self) -> None:
        self._due: float | None = None

    def wait_seconds(self, now: float) -> float:
        """Seconds until the next frame; 0 when it is due."""
        return 0.0 if self._due is None else max(self._due - now, 0.0)

    def advance(self, now: float, period: float) -> None:
        """A frame was shown; a page that is too slow is not hurried afterwards."""
        start = now if self._due is None else max(self._due, now - period)
        self._due = start + period

    def reset(self) -> None:
        """Playing stopped."""
        self._due = None
