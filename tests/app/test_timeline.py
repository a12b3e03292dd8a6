"""Segments, boundaries, colours and escaping of the strips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.app import theme, timeline
from asdfviz.app.timeline import Mark, Row, Segment, Verdict
from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth, StateEstimate
from asdfviz.render.state_ramp import state_color

A, B, BAD = Mark(0, name="a"), Mark(1, name="b"), Mark(0, is_error=True, name="bad")


@pytest.mark.parametrize(
    ("marks", "expected"),
    [
        ((), ()),
        ((None,), (Segment(0, 0, None),)),
        ((A, A, B), (Segment(0, 1, A), Segment(2, 2, B))),
        ((A, BAD, A), (Segment(0, 0, A), Segment(1, 1, BAD), Segment(2, 2, A))),
    ],
)
def test_equal_neighbours_are_joined(marks: tuple[Mark | None, ...], expected: object) -> None:
    assert timeline.segments(marks) == expected


def test_boundaries_are_of_all_rows_and_in_order() -> None:
    rows = [Row("x", "x", (1, 2, 3), (A, A, B, B)), Row("y", "y", (1, 2, 3), (None, B, B, A))]
    assert timeline.boundaries(rows) == (0, 1, 2, 3)


@pytest.mark.parametrize("count", [1, 3, 64, 1000])
def test_the_cursor_stands_in_its_own_frame(count: int) -> None:
    for place in {0, count // 2, count - 1}:
        assert timeline.frame_at(timeline.cursor_share(place, count), count) == place
    assert timeline.frame_at(1.0, count) == count - 1
    assert timeline.frame_at(-0.2, count) == 0


def test_segments_meet_on_frame_boundaries() -> None:
    html = timeline.build([Row("r", "run", (1, 2, 3), (A, A, B, B))], count=4, steps=2)
    assert "left:0.0000%;width:50.0000%" in html
    assert "left:50.0000%;width:50.0000%" in html


def test_errors_are_told_by_more_than_colour() -> None:
    html = timeline.build([Row("r", "run", (1, 2, 3), (BAD,))], count=1, steps=2)
    assert 'class="tl-error"' in html
    assert "0 bad" in html


def test_verdicts_lie_below_the_strip() -> None:
    right, gone = Verdict(verified=("jaw",)), Verdict(("base", "jaw"), ("bolt",), unlabelled=True)
    row = Row("r", "r", (1, 2, 3), (A, A, None, A), verdicts=(right, right, gone, None))
    html = timeline.build([row], count=4, steps=2)
    assert html.count("tl-verdict") == 2
    assert '<i class="tl-verdict tl-verified" data-first="0" data-last="1"' in html
    assert 'data-also="verified: jaw" style="left:0.0000%;width:50.0000%"' in html
    assert '<i class="tl-verdict tl-verified tl-gone tl-unlabelled" data-first="2"' in html
    assert gone.words == (
        "verified: base, jaw \u00b7 not in the frame: bolt \u00b7 state label taken away"
    )
    assert Verdict(gone=("a", "b", "c", "d")).words == "not in the frame: 4 parts"


def test_what_comes_from_data_is_escaped() -> None:
    evil = Mark(0, name='<img src=x onerror="x()">')
    said = Verdict(verified=('"><script>',))
    row = Row('"><b>', "<script>", (1, 2, 3), (evil,), hint='"onload', verdicts=(said,))
    html = timeline.build([row], count=1, steps=2)
    assert "<script" not in html
    assert "<img" not in html
    assert '"onload' not in html


def test_long_rows_stay_light() -> None:
    marks = tuple(Mark(i % 2) for i in range(20_000))
    verdicts = tuple(Verdict((str(i),)) for i in range(20_000))
    row = Row("r", "r", (1, 2, 3), marks, verdicts=verdicts)
    html = timeline.build([row], count=20_000, steps=2)
    assert html.count("tl-verdict") <= timeline.MAX_SEGMENTS
    assert html.count("data-state=") <= timeline.MAX_SEGMENTS


def test_marks_of_predictions(clamp: Assembly) -> None:
    error = clamp.errors[0]
    probabilities = np.zeros(len(clamp.states))
    probabilities[error.index] = 1.0
    said = FramePrediction(0, {}, StateEstimate(probabilities))
    mark = timeline.mark_of_prediction(clamp, said)
    assert mark == Mark(error.completed, True, error.name)
    assert timeline.mark_of_prediction(clamp, None) is None
    assert timeline.mark_of_prediction(clamp, FramePrediction(0, {}, None)) is None


def test_marks_of_the_truth_name_the_error(clamp: Assembly) -> None:
    error = clamp.errors[0]
    wrong = FrameTruth(0, {}, error.completed, is_error=True, attached=error.attached)
    assert timeline.mark_of_truth(clamp, wrong) == Mark(error.completed, True, error.name)
    right = FrameTruth(0, {}, 1, is_error=False)
    assert timeline.mark_of_truth(clamp, right) == Mark(1, False, clamp.states[1].name)
    last = len(clamp.steps) - 1
    unheard = timeline.mark_of_truth(clamp, FrameTruth(0, {}, last, is_error=True))
    assert unheard == Mark(last, True, f"{clamp.states[last].name}, with an error")
    alike = replace(error, index=len(clamp.states), name="alike")
    known = replace(clamp, states=(*clamp.states, alike))
    for name in (error.name, "alike"):
        mark = timeline.mark_of_truth(known, replace(wrong, error=name))
        assert mark == Mark(error.completed, True, name)
    assert timeline.mark_of_truth(clamp, FrameTruth(0, {}, None)) is None
    assert timeline.mark_of_truth(clamp, None) is None


def test_the_ramp_rises_and_text_on_it_reads() -> None:
    colors = [state_color(i, 8) for i in range(8)]
    light = [theme.luminance(c) for c in colors]
    assert light == sorted(light)
    assert all(theme.contrast(theme.ink(c), c) >= 4.5 for c in colors)


def test_parts_have_colours_of_their_own() -> None:
    colors = theme.part_colors([f"p{i}" for i in range(12)])
    assert len(set(colors.values())) == 12
