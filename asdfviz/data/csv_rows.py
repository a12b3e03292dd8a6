"""One row of a csv of results, and which of a frame's rows speaks for which part."""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Sequence as Rows
from dataclasses import dataclass

import numpy as np

from asdfviz.data.cameras import is_frame_number
from asdfviz.datatypes import Assembly, Part
from asdfviz.errors import RunError
from asdfviz.geometry.matching import cheapest_pairs
from asdfviz.geometry.shapes import Scores, Transform
from asdfviz.geometry.transforms import (
    FARTHEST,
    is_rigid,
    orthonormalized,
    point_distance,
    transform_from,
)


@dataclass(frozen=True, slots=True, eq=False)
class CsvRow:
    """What a method says of one part in one frame."""

    frame: int
    parts: tuple[str, ...]
    """Which part it is about; several where copies share the number that it gives."""
    score: float
    """Of any range, or NO_SCORE."""
    T_camera_part: Transform
    is_found: bool
    """Else the translation is zero, which says that the part was not found."""
    seconds: float | None


def parse_row(cells: Rows[str], parts: tuple[str, ...], where: str, *, time_unit: float) -> CsvRow:
    """Read the cells of a row.

    Args:
        cells: as many as there are columns.
        parts: those that its obj_id may mean.
        where: the row, for messages.
        time_unit: seconds.

    Raises:
        RunError: a cell does not hold what it should.
    """
    frame = cells[1].strip()
    if not is_frame_number(frame):
        raise RunError(f"{where}: the frame is '{cells[1][:40]}', expected a number")
    R = _numbers(cells[4], 9, f"{where}: R").reshape(3, 3)
    t_mm = _numbers(cells[5], 3, f"{where}: t")
    if np.abs(t_mm).max() >= FARTHEST * 1e3:
        raise RunError(f"{where}: t is '{cells[5]}', expected millimetres")
    is_found = bool(t_mm.any())
    T_raw = transform_from(R, t_mm * 1e-3)
    if not is_rigid(T_raw, tolerance=1e-2):
        if is_found:
            raise RunError(f"{where}: R is no rotation (determinant {np.linalg.det(R):.4g})")
        T_raw = np.eye(4)  # as the GBOT evaluator writes it
    time = float(_numbers(cells[6], 1, f"{where}: time")[0])
    return CsvRow(
        frame=int(frame),
        parts=parts,
        score=float(_numbers(cells[3], 1, f"{where}: score")[0]),
        T_camera_part=orthonormalized(T_raw),
        is_found=is_found,
        seconds=None if time < 0 else time * time_unit,
    )


def _numbers(cell: str, count: int, where: str) -> Scores:
    try:
        values = np.array(cell.split(), dtype=np.float64)
    except ValueError as error:
        raise RunError(f"{where} is '{cell}', expected {count} numbers") from error
    if values.shape != (count,) or not np.isfinite(values).all():
        raise RunError(f"{where} is '{cell}', expected {count} finite numbers")
    return values


def parts_by_id(assembly: Assembly) -> dict[str, tuple[str, ...]]:
    """The parts that an obj_id may mean, by number and by name; a name comes before a number."""
    known: dict[str, tuple[str, ...]] = {}
    for part in assembly.parts.values():
        if part.obj_id is not None:
            key = str(part.obj_id)
            known[key] = (*known.get(key, ()), part.name)
    return {**known, **{name: (name,) for name in assembly.parts}}


def rows_by_frame(rows: Rows[CsvRow], assembly: Assembly) -> dict[int, dict[str, CsvRow]]:
    """The rows that count, by frame and part.

    Of the poses of one part the one with the best score counts, the first if they are equal; of
    those about copies as many as there are copies. Which copy is which a number does not say: each
    goes on under the name of the one that was nearest to it, and begins in the order of the scores.
    A row that says that a part was not found counts where no pose of the part does.
    """
    frames: dict[int, list[CsvRow]] = {}
    for row in rows:
        frames.setdefault(row.frame, []).append(row)
    last: dict[str, Transform] = {}
    counting: dict[int, dict[str, CsvRow]] = {}
    for index in sorted(frames):
        named = _named([row for row in frames[index] if row.is_found], assembly, last)
        last |= {name: row.T_camera_part for name, row in named.items()}
        for row in frames[index]:
            free = [name for name in row.parts if name not in named]
            if free and not row.is_found:
                named[free[0]] = row
        counting[index] = named
    return counting


def _named(
    poses: Rows[CsvRow], assembly: Assembly, last: Mapping[str, Transform]
) -> dict[str, CsvRow]:
    """Of one frame; `last` tells where each part was seen last."""
    surest = sorted(poses, key=lambda row: -row.score)
    named: dict[str, CsvRow] = {}
    for row in surest:
        if len(row.parts) == 1:
            named.setdefault(row.parts[0], row)
    for copies in dict.fromkeys(row.parts for row in surest if len(row.parts) > 1):
        free = [assembly.parts[name] for name in copies if name not in named]
        kept = [row for row in surest if row.parts == copies][: len(free)]
        named |= _followed(kept, free, last)
    return named


def _followed(
    poses: Rows[CsvRow], copies: Rows[Part], last: Mapping[str, Transform]
) -> dict[str, CsvRow]:
    """Each by the name of the copy that was nearest, of the least sum of distances.

    A copy that was not seen yet counts as a diameter away: what is nearer to another one is that one.
    """
    cost = np.array([[_moved(row, part, last) for part in copies] for row in poses])
    # Where nothing tells them apart, they are in order.
    cost -= 1e-9 * np.eye(*cost.shape)
    return {copies[j].name: poses[i] for i, j in cheapest_pairs(cost)}


def _moved(row: CsvRow, part: Part, last: Mapping[str, Transform]) -> float:
    """How far the part's middle would have moved, metres."""
    if part.name not in last:
        return part.diameter
    return point_distance(row.T_camera_part, last[part.name], part.middle)
