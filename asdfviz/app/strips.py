"""What the timeline's rows of the annotation and of runs say, frame by frame."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Mapping, Sequence

from asdfviz.annotate.spoken import Spoken
from asdfviz.app import theme, timeline
from asdfviz.app.items import ANNOTATION, LoadedRun
from asdfviz.datatypes import Assembly

_LEGEND = (
    "annotation: what was said by hand. Below it a line where poses were verified, dashes where a part "
    "is not in the frame; hatched where a state label was taken away"
)


def annotation_row(assembly: Assembly, spoken: Spoken, indices: Sequence[int]) -> timeline.Row:
    """States and verdicts that people gave; `indices` are rising frame numbers."""
    marks: list[timeline.Mark | None] = [None] * len(indices)
    unlabelled = [False] * len(indices)
    for first, last, label in spoken.ranges:
        mark = timeline.mark_of_label(assembly, label)
        # Frame numbers rise: going through all of them for each label takes a second with a thousand.
        for place in range(bisect_left(indices, first), bisect_right(indices, last)):
            unlabelled[place] = mark is None and (unlabelled[place] or marks[place] is not None)
            marks[place] = mark
    verdicts = tuple(
        _verdict(assembly, spoken.verdicts.get(index, {}), unlabelled=taken)
        for index, taken in zip(indices, unlabelled, strict=True)
    )
    return timeline.Row(
        ANNOTATION,
        "annotation",
        theme.ANNOTATION,
        tuple(marks),
        hint=_LEGEND,
        verdicts=verdicts,
    )


def run_row(assembly: Assembly, run: LoadedRun) -> timeline.Row:
    """The states that a run says, and how sure it is."""
    marks = tuple(timeline.mark_of_prediction(assembly, p) for p in run.by_place)
    sure = tuple(
        None if p is None or p.state is None else float(p.state.probabilities.max())
        for p in run.by_place
    )
    hint = f"{run.label}: {run.folder}" if run.folder else f"{run.label}, being computed"
    return timeline.Row(run.id, run.label, run.color, marks, sure, hint)


def _verdict(
    assembly: Assembly, said: Mapping[str, bool], *, unlabelled: bool
) -> timeline.Verdict | None:
    if not said and not unlabelled:
        return None
    verified = tuple(part for part in assembly.parts if said.get(part) is True)
    gone = tuple(part for part in assembly.parts if said.get(part) is False)
    known = verified or gone or unlabelled
    return timeline.Verdict(verified, gone, unlabelled) if known else None
