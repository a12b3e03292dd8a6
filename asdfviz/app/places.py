"""Which frames a view shows and speaks of: going through them, and marked ranges. Pure."""

from __future__ import annotations

from dataclasses import replace

from asdfviz.app import actions as act
from asdfviz.app.view import Facts, View

_STATEMENTS = (
    act.SetState
    | act.RepeatState
    | act.ClearState
    | act.RemovePart
    | act.RevertPart
    | act.VerifyPart
    | act.PlaceJoined
)
"""Edits that use a marked range up."""


def edited(
    view: View, action: act.Action, place: int, facts: Facts, *, state: int | None = None
) -> View:
    """The view after an edit was kept: at the frame that it leads to, its range used up.

    Keys that go through the states are pressed until the right one is there: all of them are for the
    same frames. `state` is the one that was set.
    """
    if isinstance(action, act.SetState | act.RepeatState):
        view = replace(view, labelled=view.range_here)
    elif not isinstance(action, act.PlaceJoined):
        view = replace(view, labelled=None)
    if isinstance(action, act.NextState | act.NextError):
        view = replace(view, marking=None, served=True)
    elif isinstance(action, _STATEMENTS):
        view = replace(view, marked=None, marking=None)
    if place != view.place:
        # Undo led there and nobody went: frames between were never meant for a range begun before.
        view = replace(view, marking=None)
    return at(view if state is None else replace(view, state=state), place, facts)


def at(view: View, place: int, facts: Facts) -> View:
    """The view at a place; a range that is being marked comes along, one that was used up ends."""
    place = min(max(place, 0), facts.count - 1)
    marked = view.marked
    view = view if place == view.place else replace(view, labelled=None)
    if view.served and place != view.place:
        return replace(view, place=place, marked=None, served=False)
    if view.marking is not None:
        marked = (min(view.marking, place), max(view.marking, place))
    return replace(view, place=place, marked=marked)


def hold(view: View, action: act.Hold, facts: Facts) -> View:
    """Stop at a frame."""
    return at(replace(view, playing=False), action.place, facts)


def step(view: View, action: act.Step, facts: Facts) -> View:
    """Go on by some frames."""
    return at(replace(view, playing=False), view.place + action.by, facts)


def to_boundary(view: View, action: act.ToBoundary, facts: Facts) -> View:
    """Go to the next or previous state boundary, or to the end."""
    ahead = [b for b in facts.boundaries if (b - view.place) * action.direction > 0]
    if not ahead:
        end = facts.count - 1 if action.direction > 0 else 0
        return at(replace(view, playing=False), end, facts)
    target = min(ahead) if action.direction > 0 else max(ahead)
    return at(replace(view, playing=False), target, facts)


def set_range(view: View, action: act.SetRange, facts: Facts) -> View:
    """Mark frames, and show one of them."""
    first, last = sorted((action.first, action.last))
    first, last = (min(max(place, 0), facts.count - 1) for place in (first, last))
    wished = view.place if action.place is None else action.place
    place = min(max(wished, first), last)
    return replace(
        view,
        place=place,
        marked=(first, last),
        marking=None,
        labelled=None,
        served=False,
        tab="annotate",
    )


def mark_range(view: View, action: act.MarkRange, facts: Facts) -> View:
    """Begin a range at the frame shown, or end it there."""
    del action
    if view.marking is None:
        place = view.place
        return replace(view, marking=place, marked=(place, place), served=False, tab="annotate")
    return replace(at(view, view.place, facts), marking=None)
