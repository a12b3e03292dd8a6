"""From the page's script to actions: a hidden text field carries JSON, which is checked here.

viser has no click events for HTML, so the script writes its requests into a field that nobody sees.
Whatever a page could send (it is a browser: anything) is turned into a known action or dropped.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Mapping
from typing import Any, Literal, cast, get_args, get_origin, get_type_hints

from asdfviz.app import actions

MAX_LENGTH = 8000
"""Longer messages are none of ours."""

KINDS: Mapping[str, type] = {
    kind.__name__: kind
    for kind in (
        actions.Seek,
        actions.Hold,
        actions.Resume,
        actions.Step,
        actions.ToBoundary,
        actions.TogglePlay,
        actions.SetSpeed,
        actions.ToggleView,
        actions.Zoom,
        actions.FitView,
        actions.SetOpacity,
        actions.Toggle,
        actions.SetGizmo,
        actions.TogglePart,
        actions.ToggleLayer,
        actions.UseRun,
        actions.SelectPart,
        actions.NextPart,
        actions.Nudge,
        actions.Turn,
        actions.CycleStep,
        actions.TypePose,
        actions.CopyPrevious,
        actions.PlacePart,
        actions.PlaceJoined,
        actions.ToGap,
        actions.RevertPart,
        actions.RemovePart,
        actions.VerifyPart,
        actions.SetState,
        actions.ClearState,
        actions.SetRange,
        actions.MarkRange,
        actions.Cancel,
        actions.Undo,
        actions.Redo,
        actions.ShowTab,
        actions.AskOptions,
        actions.RunMethod,
        actions.StopRun,
        actions.Evaluate,
        actions.Export,
        actions.TrackPart,
        actions.FitPart,
        actions.StopTracking,
        actions.ToggleKeys,
        actions.DismissWelcome,
    )
}


def parse(message: str) -> actions.Action | None:
    """The action that a message asks for; None for anything that is not exactly one."""
    if not message or len(message) > MAX_LENGTH:
        return None
    try:
        given = json.loads(message)
    except (ValueError, RecursionError):
        return None
    if not isinstance(given, dict):
        return None
    fields = cast(dict[str, object], given)
    kind = KINDS.get(str(fields.get("kind")))
    if kind is None:
        return None
    return _build(kind, fields)


def _build(kind: type, fields: Mapping[str, object]) -> actions.Action | None:
    hints = get_type_hints(kind)
    values: dict[str, Any] = {}
    for field in dataclasses.fields(kind):
        if field.name not in fields:
            if field.default is dataclasses.MISSING:
                return None
            continue
        value = fields[field.name]
        if not _fits(value, hints[field.name]):
            return None
        values[field.name] = _taken(value, hints[field.name])
    return cast(actions.Action, kind(**values))


def _taken(value: object, hint: Any) -> object:
    """The value as the field keeps it: JSON knows no tuples, and writes whole numbers as integers."""
    if isinstance(value, list):
        values = cast(list[object], value)
        kind = next((one for one in _not_none(hint) if get_origin(one) is tuple), hint)
        return tuple(map(_taken, values, _hints_in(kind, len(values))))
    return float(cast(float, value)) if hint is float else value


def _fits(value: object, hint: Any) -> bool:
    """Whether a JSON value is of the type that a field asks for."""
    if get_origin(hint) is Literal:
        return any(type(value) is type(known) and value == known for known in get_args(hint))
    if hint is float:
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        # Not isfinite: an integer may have more digits than any float has room for.
        return number and abs(cast(float, value)) <= sys.float_info.max
    if hint is bool:
        return isinstance(value, bool)
    if hint is int:
        return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 10**9
    if type(None) in get_args(hint):
        return value is None or any(_fits(value, inner) for inner in _not_none(hint))
    if get_origin(hint) is tuple:
        return isinstance(value, list) and _fit_in(cast(list[object], value), hint)
    if get_origin(hint) is Mapping:
        return isinstance(value, dict) and _are_strings(cast(dict[object, object], value))
    return isinstance(value, str)


def _fit_in(values: list[object], hint: Any) -> bool:
    hints = _hints_in(hint, len(values))
    return len(values) == len(hints) and all(map(_fits, values, hints))


def _hints_in(hint: Any, count: int) -> tuple[Any, ...]:
    """Those of a tuple's values; one whose hint ends in `...` has any count."""
    hints = get_args(hint)
    return hints[:1] * count if hints[-1] is Ellipsis else hints


def _not_none(hint: Any) -> list[Any]:
    return [inner for inner in get_args(hint) if inner is not type(None)]


def _are_strings(value: Mapping[object, object]) -> bool:
    return all(isinstance(item, str) for pair in value.items() for item in pair)
