"""What of a view lasts when its page is loaded again or loses its connection. Pure.

The server forgets a view with its connection, so the page keeps it and tells it when it comes back. A
marked range is not kept: nobody thinks of it any more, and the next edit would be for all of it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

from asdfviz.app import actions as act
from asdfviz.app.ar import ZOOM_RANGE, clamp_centre
from asdfviz.app.places import at
from asdfviz.app.view import SPEEDS, STEPS_MM, Facts, View

OPACITY_RANGE = (0.05, 1.0)
_SWITCHES: tuple[act.Switch, ...] = get_args(act.Switch)


def kept(view: View) -> act.Resume:
    """What a page has to tell, so that its view can go on as it is."""
    return act.Resume(
        place=view.place,
        mode=view.mode,
        page=view.page,
        tab=view.tab,
        selected=view.selected,
        base=view.base if view.chosen else None,
        zoom=view.zoom,
        centre=view.centre,
        opacity=view.opacity,
        step=view.step,
        gizmo=view.gizmo,
        speed=view.speed,
        on=tuple(name for name in _SWITCHES if getattr(view, name)),
        hidden=tuple(sorted(view.hidden)),
        layers=tuple(sorted(view.layers)),
    )


def resume(view: View, action: act.Resume, facts: Facts) -> View:
    """Go on as a page was, as far as what it tells is still here.

    What corrections start from stays what it is, whatever the page had chosen.
    """
    zoom = within(action.zoom, ZOOM_RANGE)
    centre = None
    if action.centre is not None and zoom > ZOOM_RANGE[0]:
        centre = clamp_centre(action.centre, facts.size_wh)
    is_moved = (action.mode, zoom, centre) != (view.mode, view.zoom, view.centre)
    goes_back = not view.chosen and action.base in facts.layers
    switches = {name: name in action.on for name in _SWITCHES}
    resumed = replace(
        view,
        mode=action.mode,
        tab=action.tab,
        selected=action.selected if action.selected in facts.parts else None,
        base=action.base if goes_back else view.base,
        chosen=view.chosen or goes_back,
        zoom=zoom,
        centre=centre,
        turns=view.turns + is_moved,
        opacity=within(action.opacity, OPACITY_RANGE),
        step=min(max(action.step, 0), len(STEPS_MM) - 1),
        gizmo=action.gizmo,
        speed=within(action.speed, (SPEEDS[0], SPEEDS[-1])),
        hidden=frozenset(action.hidden) & set(facts.parts),
        layers=frozenset(action.layers) & set(facts.layers),
        **switches,
    )
    return at(resumed, action.place, facts)


def within(value: float, bounds: tuple[float, float]) -> float:
    """The value, or the end of the bounds beyond which it lies."""
    return min(max(value, bounds[0]), bounds[1])
