"""Rows of a csv that say that a part was not found, for the GBOT authors' rules.

Their evaluator writes a row with a zero translation for such a part, and their eval_calc_errors.py takes
it for a pose like any other: at the camera, so that ADD(S) is infinite and e_t the part's distance. By all
other rules there is no pose.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace

from asdfviz.datatypes import Assembly, FramePrediction
from asdfviz.evaluate.pose_errors import ErrorModel, error_model, pose_error
from asdfviz.evaluate.records import Comparison, PoseRecord
from asdfviz.geometry.shapes import Transform
from asdfviz.state.twins import twin_groups


def with_rows_not_found(
    comparison: Comparison, predictions: Mapping[int, FramePrediction], assembly: Assembly
) -> Comparison:
    """Note at every miss that has such a row how far off the row is (`PoseRecord.not_found`).

    Where the poses of twins are exchanged, their rows go to those that have no pose then.

    Args:
        comparison: of the predictions.
        predictions: by frame number.
        assembly: what they are about.
    """
    rows = {index: said.not_found for index, said in predictions.items() if said.not_found}
    if not rows:
        return comparison
    models = {name: error_model(part) for name, part in assembly.parts.items()}
    groups = twin_groups(assembly)
    missed: dict[int, list[str]] = {index: [] for index in rows}
    for record in comparison.exchanged:
        if record.error is None and record.frame_index in rows:
            missed[record.frame_index].append(record.part)
    exchanged = {index: _exchanged(rows[index], missed[index], groups) for index in rows}
    return replace(
        comparison,
        records=tuple(_noted(comparison.records, rows, models)),
        exchanged=tuple(_noted(comparison.exchanged, exchanged, models)),
    )


def _exchanged(
    rows: Mapping[str, Transform], missed: Collection[str], groups: Iterable[Sequence[str]]
) -> dict[str, Transform]:
    """The rows of a frame by the parts that are missed; a twin without one of its own gets another's."""
    given = {name: rows[name] for name in missed if name in rows}
    for names in groups:
        left = [rows[name] for name in names if name in rows and name not in given]
        without = [name for name in names if name in missed and name not in given]
        given |= dict(zip(without, left, strict=False))
    return given


def _noted(
    records: Iterable[PoseRecord],
    rows: Mapping[int, Mapping[str, Transform]],
    models: Mapping[str, ErrorModel],
) -> Iterable[PoseRecord]:
    for record in records:
        row = rows.get(record.frame_index, {}).get(record.part)
        if record.error is None and row is not None:
            error = pose_error(row, record.T_camera_truth, models[record.part])
            record = replace(record, not_found=error)
        yield record
