"""The gizmo: which frame a drag belongs to, without a browser."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asdfviz.app import actions as act
from asdfviz.app.gizmo import Gizmo
from asdfviz.app.snapshot import take
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace


class Handle(SimpleNamespace):
    """What viser's handles of the scene have in common."""

    def __init__(self) -> None:
        super().__init__(position=np.zeros(3), wxyz=np.array([1.0, 0.0, 0.0, 0.0]), visible=False)
        self.disable_axes = self.disable_sliders = self.disable_rotations = False

    def on_update(self, callback: Callable[[Any], Any]) -> None:
        self.callback = callback


@pytest.fixture
def handle() -> Handle:
    return Handle()


@pytest.fixture
def asked() -> list[act.Action]:
    return []


@pytest.fixture
def gizmo(with_run: Workspace, handle: Handle, asked: list[act.Action]) -> Gizmo:
    scene = SimpleNamespace(add_transform_controls=lambda *_args, **_options: handle)
    return Gizmo(scene, with_run, asked.append, {"jaw": Handle()})


def show(gizmo: Gizmo, workspace: Workspace, place: int) -> None:
    view = View(place=place, base="first", selected="jaw", mode="3d")
    gizmo.apply(take(workspace, view, frame=None))


def drag(handle: Handle, phase: str, *, by: float) -> None:
    handle.position = handle.position + np.array([by, 0.0, 0.0])
    # In a thread of its own: browser tests leave a loop running in theirs.
    with ThreadPoolExecutor(1) as own:
        own.submit(
            lambda: asyncio.run(handle.callback(SimpleNamespace(target=handle, phase=phase)))
        ).result()


def test_a_drag_tells_the_frame_where_it_was_begun(
    gizmo: Gizmo, handle: Handle, asked: list[act.Action], with_run: Workspace
) -> None:
    show(gizmo, with_run, 2)
    x = with_run.poses(2, "first")["jaw"].T_camera_part[0, 3]
    drag(handle, "start", by=0.0)
    drag(handle, "update", by=0.01)
    show(gizmo, with_run, 5)
    drag(handle, "update", by=0.03)  # over another picture
    drag(handle, "end", by=0.0)
    moves = [move for move in asked if isinstance(move, act.MovePart)]
    assert [(move.place, move.done) for move in moves] == [(2, False), (2, False), (2, True)]
    assert moves[-1].T_camera_part[0, 3] == pytest.approx(x + 0.01, abs=1e-6)
    assert gizmo.dragged is None


def test_the_next_drag_belongs_to_the_frame_shown(
    gizmo: Gizmo, handle: Handle, asked: list[act.Action], with_run: Workspace
) -> None:
    for place in (2, 5):
        show(gizmo, with_run, place)
        drag(handle, "start", by=0.0)
        drag(handle, "end", by=0.02)
    assert [move.place for move in asked if isinstance(move, act.MovePart)] == [2, 5]
