"""Settles the selected part in the shown frame by contours and depth. Nothing here knows viser."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from asdfviz.annotate.steps import group_of
from asdfviz.app.background_job import BackgroundJob
from asdfviz.app.desk import Desk
from asdfviz.app.items import JobStatus, Message
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError, Stopped
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import point_distance, rotation_angle
from asdfviz.methods.tracking import load_bodies
from asdfviz.methods.turned_fits import Doubt, HandFit, fitted_in_any_turn

DOUBTS: dict[Doubt, str] = {
    "alike": "but another pose fits as well: check it",
    "poor": "but little of it fits: check it",
    "untried": "but without depth no other turn was tried: check it",
}
FITTED = "fitted"
"""Provenance of such a pose: a person asked for it, and looks at it."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """What is settled, and from where."""

    part: str
    view: View
    """As it was when that was asked for."""
    T_camera_part: Transform
    said: tuple[str, str] | None
    """What was said last of the part there, and how; None where nobody spoke of it."""


def plan_fit(workspace: Workspace, view: View) -> Fit:
    """What settling the selected part means.

    Raises:
        AnnotationError: no part is selected, or it has no pose here.
    """
    part = Desk(workspace, view, "").part
    here = workspace.poses(view.place, view.base).get(part)
    if here is None:
        frame = workspace.indices[view.place]
        raise AnnotationError(
            f"{part} has no pose in frame {frame} to begin with: place it about where it is"
        )
    return Fit(part, view, here.T_camera_part, _said(workspace, view, part))


def _said(workspace: Workspace, view: View, part: str) -> tuple[str, str] | None:
    return workspace.said().get((workspace.indices[view.place], part))


class FitJob(BackgroundJob):
    """Settles in a thread of its own, as views of the parts may have to be made first."""

    def __init__(self, workspace: Workspace, fit: Fit) -> None:
        super().__init__(workspace, "carrying", thread="fit")
        self._fit = fit
        self._begun = JobStatus(fit.part, "running", total=1, told=f"Fitting {fit.part}")
        self._set(self._begun)

    def _work(self) -> None:
        fit, workspace = self._fit, self._workspace
        try:
            found = self._found()
            if self._stopped.is_set():
                raise Stopped("cancelled")
        except Stopped:
            self._set(replace(self._begun, state="stopped"))
            return
        self._keep(found.T_camera_part)
        doubt = f", {DOUBTS[found.doubt]}" if found.doubt else ""
        told = f"{fit.part} fitted to the picture, {self._moved(found.T_camera_part)}{doubt}"
        end = replace(self._begun, state="done", done=1, told=told, part=fit.part)
        end = replace(end, unsure=bool(doubt))
        self._set(replace(end, version=workspace.store.version()))

    def _keep(self, T_camera_part: Transform) -> None:
        """Write the pose, as one step.

        Raises:
            AnnotationError: somebody spoke of the part meanwhile, or it cannot be written.
        """
        fit, workspace = self._fit, self._workspace
        desk = Desk(workspace, fit.view, group_of(fit.view.page, f"fit@{time.monotonic():.6f}"))
        with workspace.store.transaction():
            now = workspace.poses(fit.view.place, fit.view.base).get(fit.part)
            is_same = now is not None and np.array_equal(now.T_camera_part, fit.T_camera_part)
            if not is_same or _said(workspace, fit.view, fit.part) != fit.said:
                raise AnnotationError(
                    f"in frame {desk.frame} it was changed meanwhile, so nothing was done: fit again"
                )
            desk.move(fit.part, T_camera_part, FITTED)

    def _fail(self, message: str) -> None:
        title = f"{self._fit.part} could not be fitted"
        self._workspace.say(Message(title, message, is_problem=True))
        self._set(replace(self._begun, state="failed", message=message))

    def _found(self) -> HandFit:
        """Where the picture has it.

        Raises:
            AnnotationError: nowhere near.
            Stopped: as was asked for.
        """
        fit, workspace = self._fit, self._workspace
        bodies = load_bodies(
            workspace.assembly,
            progress=lambda done, total: self._set(
                replace(self._begun, state=self._state, done=done, total=total, preparing=True)
            ),
            stop=self._stopped.is_set,
        )
        frame = workspace.frames.source[fit.view.place]
        found = fitted_in_any_turn(
            frame,
            fit.T_camera_part,
            part=workspace.assembly.parts[fit.part],
            body=bodies[fit.part],
            stop=self._stopped.is_set,
        )
        if found is None:
            raise AnnotationError(
                "its contours and depth agree with no place near: move or turn it nearer first"
            )
        return found

    def _moved(self, T_camera_part: Transform) -> str:
        """How far, in words."""
        before = self._fit.T_camera_part
        middle = self._workspace.assembly.parts[self._fit.part].middle
        by_mm = 1e3 * point_distance(T_camera_part, before, middle)
        turn = rotation_angle(T_camera_part[:3, :3].T @ before[:3, :3])
        return f"moved by {by_mm:.1f} mm and turned by {np.degrees(turn):.1f}°"
