"""What a person says of the state: this one, the one beside it, the last one again, none.

A label holds for the frame shown, or for the marked range around it, as one step of undo.
"""

from __future__ import annotations

from asdfviz.annotate.records import label_of
from asdfviz.app import actions as act
from asdfviz.app import timeline
from asdfviz.app.desk import Desk, Done
from asdfviz.errors import AnnotationError


def give(
    action: act.SetState | act.NextState | act.NextError | act.RepeatState | act.ClearState,
    desk: Desk,
) -> Done:
    """Keep a label, or take it away.

    Raises:
        AnnotationError: there is no such state, or nothing would change; the message says why.
    """
    match action:
        case act.SetState():
            return _set(action.state, desk)
        case act.NextState():
            return _set(_beside(action, desk), desk)
        case act.NextError():
            return _set(_error(desk), desk)
        case act.RepeatState():
            return _set(_last(desk), desk)
        case act.ClearState():
            return _clear(desk)


def _set(state: int, desk: Desk) -> Done:
    states = desk.workspace.assembly.states
    if not 0 <= state < len(states):
        raise AnnotationError(f"there is no state {state}; states: 0 to {len(states) - 1}")
    desk.begin()
    first, last = desk.span
    label = label_of(states[state])
    desk.workspace.store.set_state(first, label, last_frame=last, group=desk.group)
    said = f"state of {desk.where}: {states[state].name}"
    return Done(said, desk.view.place, state=state)


def _beside(action: act.NextState, desk: Desk) -> int:
    """The correct state beside the one of the frame shown; an error lies between two of them."""
    steps = desk.workspace.assembly.steps
    mark, _ = desk.workspace.mark(desk.view.place, desk.view.base)
    if mark is None and action.by > 0:
        mark = _before(desk)
    if mark is None:
        if action.by < 0:
            raise AnnotationError(
                f"no state is known in frame {desk.frame}: Shift N sets the first"
            )
        return 0
    state = mark.state + (action.by > 0 if mark.is_error else action.by)
    if not 0 <= state < len(steps):
        end = "last" if action.by > 0 else "first"
        raise AnnotationError(
            f"frame {desk.frame} is in the {end} state already; Shift X sets errors"
        )
    return state


def _error(desk: Desk) -> int:
    """The error after the one of the frame shown; the first that can follow its step where it has none."""
    mark, _ = desk.workspace.mark(desk.view.place, desk.view.base)
    mark = mark or _before(desk)
    if mark is None:
        raise AnnotationError(f"no state is known in frame {desk.frame}: Shift N sets the first")
    assembly = desk.workspace.assembly
    errors = [error for error in assembly.errors if error.completed == mark.state]
    if not errors:
        names = {assembly.states[error.completed].name: None for error in assembly.errors}
        where = f"errors follow {', '.join(names)}" if names else f"{assembly.name} has none"
        raise AnnotationError(f"no error state follows the step of frame {desk.frame}; {where}")
    now = next((i for i, e in enumerate(errors) if mark.is_error and e.name == mark.name), -1)
    return errors[(now + 1) % len(errors)].index


def _before(desk: Desk) -> timeline.Mark | None:
    """The last state that is known before the frames: what is built goes on from there."""
    marks = (
        desk.workspace.mark(place, desk.view.base)[0]
        for place in range(desk.view.frames[0] - 1, -1, -1)
    )
    return next((mark for mark in marks if mark is not None), None)


def _last(desk: Desk) -> int:
    if desk.view.state is None:
        raise AnnotationError("no state was set yet: set one in the Annotate tab, or with Shift N")
    return desk.view.state


def _clear(desk: Desk) -> Done:
    """Take the label of the frames away; what corrections started from counts again."""
    if not desk.workspace.is_labelled(*desk.view.frames):
        raise AnnotationError(f"no state was set by hand in {desk.where}")
    first, last = desk.span
    desk.workspace.store.set_state(first, None, last_frame=last, group=desk.group)
    return Done(f"state label taken from {desk.where}", desk.view.place)
