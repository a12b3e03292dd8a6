"""Begins and stops what works in the background, as a person asked. Nothing here knows viser."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from asdfviz.app import actions as act
from asdfviz.app.carrying import plan
from asdfviz.app.fitting import plan_fit
from asdfviz.app.jobs import Background
from asdfviz.app.options import config_from
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.errors import MethodError
from asdfviz.methods.spec import BrokenMethod, MethodSpec


def begin_or_stop(
    action: act.Action,
    view: View,
    workspace: Workspace,
    background: Background,
    methods: Mapping[str, MethodSpec | BrokenMethod],
) -> View:
    """Begin or stop what an action asks for; any other action does nothing.

    Returns:
        The view, at the tab that tells how far it is.

    Raises:
        InputError: it cannot begin; the message says what would be right.
    """
    match action:
        case act.RunMethod():
            return _run(action, view, background, methods)
        case act.StopRun():
            background.stop()
        case act.TrackPart():
            background.track(plan(workspace, view, action.direction))
        case act.FitPart():
            background.fit(plan_fit(workspace, view))
        case act.StopTracking():
            background.stop_tracking()
        case act.Evaluate():
            background.judge()
            return replace(view, tab="results")
        case act.Export():
            background.export(view.base, guesses=action.unchecked)
        case _:
            pass
    return view


def _run(
    action: act.RunMethod,
    view: View,
    background: Background,
    methods: Mapping[str, MethodSpec | BrokenMethod],
) -> View:
    spec = methods.get(action.method)
    if not isinstance(spec, MethodSpec):
        raise MethodError(f"there is no method '{action.method}' that can be run")
    known = view.options
    given = known.get(action.method, {}) if action.options is None else action.options
    background.run(spec, config_from(spec.config, given))
    options = {**known, action.method: given}
    return replace(view, tab="methods", asking=None, options=options)
