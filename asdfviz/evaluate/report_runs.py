"""What the report page says of a run: its figures by both protocols, its worst frames, its doubts."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from asdfviz.datatypes import FrameTruth
from asdfviz.errors import SequenceError
from asdfviz.evaluate.evaluate import protocol_report
from asdfviz.evaluate.inputs import Result, changed_inputs
from asdfviz.evaluate.judgement import Judgement, judge
from asdfviz.evaluate.protocols import VISIBLE
from asdfviz.evaluate.report_pictures import Shot, worst_shots


@dataclass(frozen=True)
class JudgedRun:
    """A run with everything that the page says of it."""

    name: str
    """Its method, and its folder where two runs of a sequence have one method."""
    place: int
    """Of its name among all, for its colour."""
    sequence_name: str
    """The scene folder, with as many folders above as tell it from the others."""
    result: Result
    judgement: Judgement
    strict: Mapping[str, Any]
    gbot: Mapping[str, Any]
    shots: tuple[Shot, ...]
    notes: tuple[str, ...]
    """What a reader should know before believing the figures."""

    @property
    def config(self) -> str:
        """The method's options as JSON."""
        return json.dumps(dict(self.result.run.config), indent=2, ensure_ascii=False)


def judged_run(
    result: Result,
    name: str,
    *,
    place: int,
    sequence_name: str,
    pictures: int,
    max_bytes: int,
) -> JudgedRun:
    """Judge a run and draw its worst frames; frames that are gone become a note.

    Raises:
        RunError: the run does not fit its assembly.
        RenderError: pictures are wanted and nothing can be drawn here.
    """
    judgement = judge(
        result.run,
        assembly=result.assembly,
        truth=result.truth,
        views=result.view,
    )
    notes = [*judgement.warnings, *changed_inputs(result.run, result.assembly)]
    shots: tuple[Shot, ...] = ()
    try:
        shots = tuple(worst_shots(result, judgement, count=pictures, max_bytes=max_bytes))
    except SequenceError as error:
        notes.append(f"no pictures: {error}")
    return JudgedRun(
        name=name,
        place=place,
        sequence_name=sequence_name,
        result=result,
        judgement=judgement,
        strict=protocol_report(judgement, protocol="strict"),
        gbot=protocol_report(judgement, protocol="gbot"),
        shots=shots,
        notes=tuple(notes),
    )


def judged_frames_of(runs: Sequence[JudgedRun]) -> list[FrameTruth]:
    """The frames of a sequence, in order, that count for any of its runs: some may have been given the first."""
    found = {frame.frame_index: frame for run in runs for frame in run.judgement.frames}
    return [found[index] for index in sorted(found)]


def frame_errors_mm(
    run: JudgedRun, frames: Sequence[int]
) -> tuple[list[float | None], list[float]]:
    """Of each frame's visible parts the mean ADD(S) where there are poses, and the share without one."""
    found: dict[int, list[float]] = {index: [] for index in frames}
    lost = Counter[int]()
    for record in run.judgement.comparison.records:
        if record.visible < VISIBLE:
            continue
        if record.error is None:
            lost[record.frame_index] += 1
        else:
            found.setdefault(record.frame_index, []).append(1000 * record.error.add_s)
    means = [float(np.mean(found[index])) if found[index] else None for index in frames]
    return means, [lost[i] / max(lost[i] + len(found[i]), 1) for i in frames]
