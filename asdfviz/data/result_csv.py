"""Reads results that other programs wrote: BOP's csv and the csv of the GBOT evaluator.

    BOP   scene_id,im_id,obj_id,score,R,t,time      a header, obj_id a number, time in seconds
    GBOT  scene,frame,name,-1,R,t,time              no header, names, time in milliseconds

R is 9 numbers row by row and t 3 numbers in millimetres, both with spaces between.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence as Rows
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asdfviz.data.hashes import file_sha256
from asdfviz.datatypes import Assembly, FramePrediction, PoseEstimate, Run, Sequence
from asdfviz.errors import RunError
from asdfviz.geometry.shapes import Scores, Transform
from asdfviz.geometry.transforms import is_rigid, orthonormalized, transform_from

_HEADER = ["scene_id", "im_id", "obj_id", "score", "R", "t", "time"]


@dataclass(frozen=True, slots=True, eq=False)
class _Row:
    frame: int
    part: str
    score: float
    T_camera_part: Transform
    seconds: float | None


def read_result_csv(
    path: Path,
    *,
    sequence: Sequence,
    assembly: Assembly,
    scene: str | None = None,
    method: str | None = None,
) -> Run:
    """Read the results for a sequence as a run, which compares with runs made here.

    Every frame of the sequence from the first row on gets a prediction, empty where there is no
    row: a frame left out is a miss. Frames before the first row were given to the method as its
    start and stay out. Of two rows for one part the better score counts. A translation of zero is
    how the GBOT evaluator writes a part that was not found, so such rows are left out.

    Args:
        path: the csv.
        sequence: gives the frame numbers.
        assembly: gives the parts; repeated numbers stand for the first part that has them.
        scene: which scene's rows to take; without it, those of the only scene, or of the one that is
            called (or numbered) as the sequence's folder.
        method: what to call the method; without it, the file's name.

    Raises:
        RunError: with the line; or no row fits.
    """
    lines = _read_lines(path)
    is_bop = [cell.strip() for cell in lines[0]] == _HEADER
    first = 1 if is_bop else 0
    known = _parts_by_id(assembly)
    wanted = _wanted_scene(path, lines[first:], scene, folder=Path(sequence.path).name)
    rows: list[_Row] = []
    unknown = 0
    for number, cells in enumerate(lines[first:], start=first + 1):
        if cells[0].strip() != wanted:
            continue
        part = known.get(cells[2].strip())
        if part is None:
            unknown += 1
            continue
        row = _parse_row(
            cells, part, where=f"{path} line {number}", time_unit=1.0 if is_bop else 1e-3
        )
        if row is not None:
            rows.append(row)
    predictions = _predictions(rows, sequence, path)
    is_started = predictions[0].frame_index != sequence.frame_indices[0]
    return Run(
        method=method or path.stem,
        config={"file": str(path.resolve()), "scene": wanted, "rows_of_unknown_objects": unknown},
        sequence=sequence.path,
        assembly=assembly.path,
        version="unknown",
        predictions=predictions,
        hashes={"results": file_sha256(path)},
        initial="first_frame_truth" if is_started else "none",
    )


def _read_lines(path: Path) -> list[list[str]]:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            lines = [cells for cells in csv.reader(file) if cells]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RunError(f"{path} cannot be read as csv: {error}") from error
    if not lines:
        raise RunError(f"{path} is empty; it needs rows of {', '.join(_HEADER)}")
    for number, cells in enumerate(lines, start=1):
        if len(cells) != len(_HEADER):
            raise RunError(
                f"{path} line {number}: {len(cells)} columns, expected {', '.join(_HEADER)}"
            )
    return lines


def _parts_by_id(assembly: Assembly) -> dict[str, str]:
    known: dict[str, str] = {}
    for part in assembly.parts.values():
        if part.obj_id is not None:
            known.setdefault(str(part.obj_id), part.name)
    return {**known, **{name: name for name in assembly.parts}}


def _wanted_scene(path: Path, lines: Rows[Rows[str]], scene: str | None, *, folder: str) -> str:
    scenes = sorted({cells[0].strip() for cells in lines})
    if scene is None and len(scenes) == 1:
        return scenes[0]
    wanted = folder if scene is None else scene
    found = [name for name in scenes if wanted in (name, name.zfill(len(wanted)))]
    if not found:
        asked = "say which scene is meant" if scene is None else f"it has no scene '{scene}'"
        raise RunError(f"{path}: {asked}; scenes: {', '.join(scenes) or 'none'}")
    return found[0]


def _parse_row(cells: Rows[str], part: str, *, where: str, time_unit: float) -> _Row | None:
    """Read one row; None where it says that the part was not found."""
    R = _numbers(cells[4], 9, f"{where}: R").reshape(3, 3)
    t_mm = _numbers(cells[5], 3, f"{where}: t")
    if not t_mm.any():
        return None
    T_raw = transform_from(R, t_mm * 1e-3)
    if not is_rigid(T_raw, tolerance=1e-2):
        raise RunError(f"{where}: R is no rotation (determinant {np.linalg.det(R):.4g})")
    score = float(_numbers(cells[3], 1, f"{where}: score")[0])
    time = float(_numbers(cells[6], 1, f"{where}: time")[0])
    frame = cells[1].strip()
    if not (frame.isascii() and frame.isdigit()):
        raise RunError(f"{where}: the frame is '{cells[1]}', expected a number")
    return _Row(
        frame=int(frame),
        part=part,
        # -1 says that the method gives no score.
        score=1.0 if score < 0 else min(score, 1.0),
        T_camera_part=orthonormalized(T_raw),
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


def _predictions(rows: Rows[_Row], sequence: Sequence, path: Path) -> tuple[FramePrediction, ...]:
    frames = set(sequence.frame_indices)
    outside = sorted({row.frame for row in rows} - frames)
    if outside:
        raise RunError(
            f"{path} has rows for frame {outside[0]}, which {sequence.name} does not have; "
            "is it the result of another scene?"
        )
    if not rows:
        raise RunError(f"{path} has no pose of a known part; is it of another assembly?")
    best: dict[int, dict[str, _Row]] = {}
    for row in rows:
        of_frame = best.setdefault(row.frame, {})
        if row.part not in of_frame or row.score > of_frame[row.part].score:
            of_frame[row.part] = row
    start = min(best)
    return tuple(_prediction(i, best.get(i, {})) for i in sequence.frame_indices if i >= start)


def _prediction(index: int, rows: dict[str, _Row]) -> FramePrediction:
    seconds = [row.seconds for row in rows.values() if row.seconds is not None]
    return FramePrediction(
        frame_index=index,
        poses={
            name: PoseEstimate(
                part=name, T_camera_part=row.T_camera_part, score=row.score, stage="tracked"
            )
            for name, row in rows.items()
        },
        state=None,
        # Both formats repeat the time of the whole image in each of its rows.
        runtime={"total": max(seconds)} if seconds else {},
    )
