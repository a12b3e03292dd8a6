"""What a page may ask for; anything else is dropped."""

from __future__ import annotations

import json

import pytest

from asdfviz.app import actions as act
from asdfviz.app.bridge import KINDS, parse


@pytest.mark.parametrize(
    ("message", "action"),
    [
        ('{"kind": "Seek", "place": 3, "n": 7}', act.Seek(3)),
        ('{"kind": "Seek", "place": 3, "part": "jaw"}', act.Seek(3, "jaw")),
        ('{"kind": "Resume", "place": 3, "mode": "3d"}', act.Resume(3, "3d")),
        ('{"kind": "Resume", "page": "a1", "place": 0, "mode": "ar"}', act.Resume(0, "ar", "a1")),
        (
            '{"kind": "Resume", "place": 0, "mode": "ar", "centre": [3, 4.5], "on": [], "hidden": ["jaw"]}',
            act.Resume(0, "ar", centre=(3.0, 4.5), on=(), hidden=("jaw",)),
        ),
        ('{"kind": "Zoom", "factor": 2}', act.Zoom(2.0)),
        ('{"kind": "Zoom", "factor": 1.5, "x": 0.5, "y": -1}', act.Zoom(1.5, 0.5, -1.0)),
        ('{"kind": "SelectPart", "part": null}', act.SelectPart(None)),
        ('{"kind": "ShowTab", "tab": "results"}', act.ShowTab("results")),
        ('{"kind": "Toggle", "what": "xray"}', act.Toggle("xray")),
        ('{"kind": "Export", "unchecked": true}', act.Export(unchecked=True)),
        ('{"kind": "RunMethod", "method": "asdf"}', act.RunMethod("asdf")),
        (
            '{"kind": "RunMethod", "method": "asdf", "options": {"detector.image_size": "320"}}',
            act.RunMethod("asdf", {"detector.image_size": "320"}),
        ),
    ],
)
def test_known_requests(message: str, action: act.Action) -> None:
    assert parse(message) == action


@pytest.mark.parametrize(
    "message",
    [
        "",
        "no json",
        "[1, 2]",
        "3",
        '{"kind": "Seek"}',
        '{"kind": "Seek", "place": "3"}',
        '{"kind": "Seek", "place": true}',
        '{"kind": "Seek", "place": 1e99}',
        '{"kind": "Seek", "place": 99999999999}',
        '{"kind": "Zoom", "factor": NaN}',
        '{"kind": "Zoom", "factor": -Infinity}',
        pytest.param('{"kind": "Zoom", "factor": 1' + "0" * 400 + "}", id="400 digits"),
        '{"kind": "ShowTab", "tab": "secrets"}',
        '{"kind": "Export", "unchecked": 1}',
        '{"kind": "MovePart", "part": "jaw"}',
        '{"kind": "Changed"}',
        '{"kind": "Resume", "place": 3, "mode": "4d"}',
        '{"kind": "Resume", "place": 3, "mode": "3d", "centre": [1]}',
        '{"kind": "Resume", "place": 3, "mode": "3d", "hidden": "jaw"}',
        '{"kind": "Resume", "place": 3, "mode": "3d", "on": ["lights"]}',
        '{"kind": ["Seek"], "place": 3}',
        '{"kind": "RunMethod", "method": "asdf", "options": {"a": 1}}',
        '{"kind": "RunMethod", "method": "asdf", "options": ["a"]}',
        json.dumps({"kind": "SelectPart", "part": "x" * 9000}),
        "[" * 1900,
    ],
)
def test_anything_else_is_dropped(message: str) -> None:
    assert parse(message) is None


def test_every_kind_is_an_action_by_its_own_name() -> None:
    assert all(getattr(act, name) is kind for name, kind in KINDS.items())


@pytest.mark.parametrize(("axis", "sign"), [(7, 1), (0, 0), (True, 1), (0, 1.0), (-1, 1)])
def test_an_axis_that_is_none_is_dropped(axis: float, sign: float) -> None:
    for kind in ("Nudge", "Turn"):
        assert parse(json.dumps({"kind": kind, "axis": axis, "sign": sign})) is None
