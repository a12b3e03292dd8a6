"""What one person sees, and how actions change it. Pure: no viser, no disk, tested without a browser.

Selection, view, zoom and playback are each person's own and live here; poses, states and runs are
shared and live in the workspace. Its data are in `view`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from asdfviz.app import actions as act
from asdfviz.app.ar import clamp_centre, zoom_about
from asdfviz.app.places import at, hold, mark_range, set_range, step, to_boundary
from asdfviz.app.resuming import OPACITY_RANGE, resume, within
from asdfviz.app.view import SPEEDS, STEPS_MM, TRUTH, Facts, View, centre_of, window_of


def update(view: View, action: act.Action, facts: Facts) -> View:
    """The view after an action; edits and jobs leave it as it is."""
    rule = _RULES.get(type(action))
    return view if rule is None else rule(view, action, facts)


def asked_for(view: View, action: act.Action, *, is_tracking: bool = False) -> act.Action | None:
    """What to do for an action; a key does nothing while a card is open that it does not close.

    The welcome is no such card: it has keys to be tried. Without a card the key that cancels stops what
    tracks or fits before it lets go of a range or a part.
    """
    if not isinstance(action, act.ByKey):
        return action
    closing = act.Cancel if view.asking is not None else act.Cancel | act.ToggleKeys
    is_covered = view.keys or view.asking is not None
    if is_tracking and not is_covered and isinstance(action.action, act.Cancel):
        return act.StopTracking()
    return None if is_covered and not isinstance(action.action, closing) else action.action


def settled(view: View, facts: Facts) -> View:
    """The view after the workspace changed: what is gone is no longer shown."""
    base = view.base
    # The truth stands in where there is no run yet, unless somebody chose it or works on it.
    is_settled = view.chosen or facts.is_corrected
    stands_in = base == TRUTH and not is_settled and facts.preferred is not None
    if base not in facts.layers or stands_in:
        base = facts.preferred or (TRUTH if facts.has_truth else None)
    return replace(
        view,
        base=base,
        layers=view.layers & set(facts.layers),
        selected=view.selected if view.selected in facts.parts else None,
        place=min(view.place, facts.count - 1),
    )


def _seek(view: View, action: act.Seek, facts: Facts) -> View:
    if action.part in facts.parts:
        # Who asks for a part in a frame wants to see how it lies there: beside where it is in truth.
        truth = {TRUTH} if facts.has_truth else set[str]()
        selected = _select(view, act.SelectPart(action.part), facts)
        view = replace(selected, tab=view.tab, layers=view.layers | truth)
    return at(view, action.place, facts)


def _toggle_play(view: View, action: act.TogglePlay, facts: Facts) -> View:
    del action
    if facts.count < 2:
        return view
    at_end = view.place == facts.count - 1 and not view.playing
    return at(replace(view, playing=not view.playing), 0 if at_end else view.place, facts)


def _set_speed(view: View, action: act.SetSpeed, facts: Facts) -> View:
    del facts
    return replace(view, speed=min(max(action.speed, SPEEDS[0]), SPEEDS[-1]))


def _toggle_view(view: View, action: act.ToggleView, facts: Facts) -> View:
    del action, facts
    return replace(view, mode="3d" if view.mode == "ar" else "ar", turns=view.turns + 1)


def _zoom(view: View, action: act.Zoom, facts: Facts) -> View:
    if view.mode != "ar" or action.factor <= 0:
        return view
    zoom, centre = zoom_about(
        window_of(view, facts),
        centre_of(view, facts),
        zoom=view.zoom,
        factor=action.factor,
        ndc=(min(max(action.x, -1.0), 1.0), min(max(action.y, -1.0), 1.0)),
    )
    return replace(view, zoom=zoom, centre=centre, turns=view.turns + 1)


def _fit(view: View, action: act.FitView, facts: Facts) -> View:
    del action, facts
    return replace(view, zoom=1.0, centre=None, turns=view.turns + 1)


def _look(view: View, action: act.Look, facts: Facts) -> View:
    if view.mode != "ar" or view.zoom <= 1.0:
        return view
    return replace(view, centre=clamp_centre((action.u, action.v), facts.size_wh))


def _resized(view: View, action: act.Resized, facts: Facts) -> View:
    del facts
    # The free camera keeps its place; the pinned one must show the whole picture again.
    return replace(view, aspect=action.aspect, turns=view.turns + (view.mode == "ar"))


def _drifted(view: View, action: act.Drifted, facts: Facts) -> View:
    del action, facts
    return replace(view, turns=view.turns + (view.mode == "ar"))


def _set_opacity(view: View, action: act.SetOpacity, facts: Facts) -> View:
    del facts
    return replace(view, opacity=within(action.opacity, OPACITY_RANGE))


def _toggle(view: View, action: act.Toggle, facts: Facts) -> View:
    del facts
    changed: dict[str, Any] = {action.what: not getattr(view, action.what)}
    return replace(view, **changed)


def _set_gizmo(view: View, action: act.SetGizmo, facts: Facts) -> View:
    del facts
    return replace(view, gizmo=action.gizmo)


def _cycle_gizmo(view: View, action: act.CycleGizmo, facts: Facts) -> View:
    del action, facts
    order = act.GIZMOS
    return replace(view, gizmo=order[(order.index(view.gizmo) + 1) % len(order)])


def _toggle_part(view: View, action: act.TogglePart, facts: Facts) -> View:
    del facts
    return replace(view, hidden=view.hidden ^ {action.part})


def _toggle_layer(view: View, action: act.ToggleLayer, facts: Facts) -> View:
    return replace(view, layers=(view.layers ^ {action.layer}) & set(facts.layers))


def _toggle_layer_at(view: View, action: act.ToggleLayerAt, facts: Facts) -> View:
    if not 1 <= action.number <= len(facts.layers):
        return view
    return replace(view, layers=view.layers ^ {facts.layers[action.number - 1]})


def _use_run(view: View, action: act.UseRun, facts: Facts) -> View:
    return replace(view, base=action.run, chosen=True) if action.run in facts.layers else view


def _select(view: View, action: act.SelectPart, facts: Facts) -> View:
    if action.part is None or action.part not in facts.parts:
        return replace(view, selected=None)
    return replace(
        view,
        selected=action.part,
        chosen=view.chosen or view.base is not None,
        tab="annotate",
        playing=False,
        hidden=view.hidden - {action.part},
    )


def _next_part(view: View, action: act.NextPart, facts: Facts) -> View:
    if view.selected is None:
        place = 0 if action.by > 0 else len(facts.parts) - 1
    else:
        place = (facts.parts.index(view.selected) + action.by) % len(facts.parts)
    return _select(view, act.SelectPart(facts.parts[place]), facts)


def _cycle_step(view: View, action: act.CycleStep, facts: Facts) -> View:
    del action, facts
    return replace(view, step=(view.step + 1) % len(STEPS_MM))


def _cancel(view: View, action: act.Cancel, facts: Facts) -> View:
    del action, facts
    if view.keys or view.asking is not None:
        return replace(view, keys=False, asking=None)
    if view.marked is not None:
        return replace(view, marked=None, marking=None)
    return replace(view, selected=None)


def _show_tab(view: View, action: act.ShowTab, facts: Facts) -> View:
    del facts
    return replace(view, tab=action.tab)


def _ask_options(view: View, action: act.AskOptions, facts: Facts) -> View:
    del facts
    return replace(view, asking=action.method, keys=False, playing=False)


def _toggle_keys(view: View, action: act.ToggleKeys, facts: Facts) -> View:
    del action, facts
    return replace(view, keys=not view.keys)


def _dismiss(view: View, action: act.DismissWelcome, facts: Facts) -> View:
    del action, facts
    return replace(view, welcome=False)


def _pause(view: View, action: act.Action, facts: Facts) -> View:
    """An edit looks at one frame: playing stops."""
    del action, facts
    return replace(view, playing=False)


_RULES: Mapping[type, Callable[[View, Any, Facts], View]] = {
    act.Seek: _seek,
    act.Hold: hold,
    act.Resume: resume,
    act.Step: step,
    act.ToBoundary: to_boundary,
    act.TogglePlay: _toggle_play,
    act.SetSpeed: _set_speed,
    act.ToggleView: _toggle_view,
    act.Zoom: _zoom,
    act.FitView: _fit,
    act.Look: _look,
    act.Resized: _resized,
    act.Drifted: _drifted,
    act.SetOpacity: _set_opacity,
    act.Toggle: _toggle,
    act.SetGizmo: _set_gizmo,
    act.CycleGizmo: _cycle_gizmo,
    act.TogglePart: _toggle_part,
    act.ToggleLayer: _toggle_layer,
    act.ToggleLayerAt: _toggle_layer_at,
    act.UseRun: _use_run,
    act.SelectPart: _select,
    act.NextPart: _next_part,
    act.CycleStep: _cycle_step,
    act.SetRange: set_range,
    act.MarkRange: mark_range,
    act.Cancel: _cancel,
    act.ShowTab: _show_tab,
    act.AskOptions: _ask_options,
    act.ToggleKeys: _toggle_keys,
    act.DismissWelcome: _dismiss,
    act.Nudge: _pause,
    act.Turn: _pause,
    act.MovePart: _pause,
    act.TypePose: _pause,
    act.RemovePart: _pause,
    act.VerifyPart: _pause,
    act.PlaceJoined: _pause,
    act.PlacePart: _pause,
    act.NextState: _pause,
    act.NextError: _pause,
    act.RepeatState: _pause,
    act.TrackPart: _pause,
    act.FitPart: _pause,
}
