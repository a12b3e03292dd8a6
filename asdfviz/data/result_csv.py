"""Reads results that other programs wrote: BOP's csv and the csv of the GBOT evaluator.

    BOP   scene_id,im_id,obj_id,score,R,t,time      a header, obj_id a number, time in seconds
    GBOT  scene,frame,name,-1,R,t,time              no header, names, time in milliseconds

R is 9 numbers row by row and t 3 numbers in millimetres, both with spaces between. Objects go by the
part's name or by its obj_id.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence as Rows
from pathlib import Path

from asdfviz.data.csv_layout import NO_SCORE, read_lines
from asdfviz.data.csv_rows import CsvRow, parse_row, parts_by_id, rows_by_frame
from asdfviz.data.hashes import file_sha256
from asdfviz.data.run_files import load_run
from asdfviz.datatypes import Assembly, FramePrediction, PoseEstimate, Run, Sequence
from asdfviz.errors import RunError, counted, some

NOTES = "csv_notes"
"""Key of a run's config: what whoever judges it should know of how the csv was read, as sentences."""
FRAMES_WITH_ROWS = "frames_with_rows"
"""Another: how many frames have any; only there where many have none."""
GIVEN_BEFORE = "given_before"
"""Another: whether the first frame is the one after what the method was given as its start."""
_MANY_WITH_ROWS = 0.9
"""Share of the frames; from here on, what has none may be what the method did not find."""


def load_run_or_csv(path: Path, *, sequence: Sequence, assembly: Assembly) -> Run:
    """Load the folder of a saved run, or a csv with results for the sequence.

    Raises:
        RunError: it cannot be read, or does not fit the assembly or the sequence.
    """
    if path.is_file() or (path.suffix.lower() == ".csv" and not path.exists()):
        return read_result_csv(path, sequence=sequence, assembly=assembly)
    return load_run(path, assembly=assembly)


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
    row: a frame left out is a miss. In the trackers' csv of GBOT, frames before the first row were
    given to the method as its start and stay out. Of two rows for one part the better score counts;
    of rows with a number that copies share, as many as there are copies (`rows_by_frame`).
    A translation of zero, which the GBOT evaluator writes for a part that it did not find, is no pose;
    the prediction keeps it apart.

    Args:
        path: the csv.
        sequence: gives the frame numbers.
        assembly: gives the parts.
        scene: which scene's rows to take; without it, those of the only scene, or of the one that is
            called (or numbered) as the sequence's folder.
        method: what to call the method; without it, the file's name.

    Raises:
        RunError: with the line; or no row fits.
    """
    lines, is_bop = read_lines(path)
    results = lines[1 if is_bop else 0 :]
    wanted = _wanted_scene(path, results, scene, folder=Path(sequence.path).name)
    rows, unknown = _rows_of(wanted, path, results, assembly, is_bop=is_bop)
    _require_poses(rows, unknown, assembly, path)
    predictions = _predictions(rows, sequence, assembly, path, is_bop=is_bop)
    is_started = predictions[0].frame_index != sequence.frame_indices[0]
    return Run(
        method=method or path.stem,
        config={
            "file": str(path.resolve()),
            "scene": wanted,
            GIVEN_BEFORE: is_started,
            **_left_out(unknown),
            **_noted(path, rows, predictions, sequence, is_bop=is_bop),
        },
        sequence=sequence.path,
        assembly=assembly.path,
        version="unknown",
        predictions=predictions,
        hashes={"results": file_sha256(path)},
        initial="first_frame_truth" if is_started else "none",
        says_states=False,
    )


def _rows_of(
    scene: str, path: Path, lines: Rows[Rows[str]], assembly: Assembly, *, is_bop: bool
) -> tuple[list[CsvRow], Counter[str]]:
    """The scene's rows of known parts, and how many there are of each object that is none."""
    rows: list[CsvRow] = []
    unknown: Counter[str] = Counter()
    known, time_unit, first = parts_by_id(assembly), 1.0 if is_bop else 1e-3, 2 if is_bop else 1
    for number, cells in enumerate(lines, start=first):
        obj_id = cells[2].strip()
        if cells[0].strip() != scene:
            continue
        if obj_id in known:
            where = f"{path} line {number}"
            rows.append(parse_row(cells, known[obj_id], where, time_unit=time_unit))
        else:
            unknown[obj_id] += 1
    return rows, unknown


def _require_poses(
    rows: Rows[CsvRow], unknown: Counter[str], assembly: Assembly, path: Path
) -> None:
    if not any(row.is_found for row in rows):
        strangers = f": its objects are {some(sorted(unknown))}" if unknown else ""
        ids = some(parts_by_id(assembly))
        raise RunError(f"{path} has no pose of a known part{strangers}; {assembly.name} has {ids}")


def scenes_in(path: Path) -> list[str]:
    """The scenes that a csv has rows of, as it calls them.

    Raises:
        RunError: it cannot be read.
    """
    lines, is_bop = read_lines(path)
    return _scenes(lines[1 if is_bop else 0 :])


def _scenes(lines: Rows[Rows[str]]) -> list[str]:
    return sorted({cells[0].strip() for cells in lines})


def _wanted_scene(path: Path, lines: Rows[Rows[str]], scene: str | None, *, folder: str) -> str:
    scenes = _scenes(lines)
    if scene is None and len(scenes) == 1:
        return scenes[0]
    wanted = folder if scene is None else scene
    found = [name for name in scenes if wanted in (name, name.zfill(len(wanted)))]
    if not found:
        asked = "say which scene is meant" if scene is None else f"it has no scene '{scene}'"
        raise RunError(f"{path}: {asked}; scenes: {', '.join(scenes) or 'none'}")
    return found[0]


def _left_out(unknown: Counter[str]) -> dict[str, object]:
    return {"rows_of_unknown_objects": unknown.total(), "unknown_objects": sorted(unknown)}


def _told_gbot(path: Path, predictions: Rows[FramePrediction], sequence: Sequence) -> str:
    """What GBOT's layout means that BOP's does not."""
    before = len(sequence) - len(predictions)
    given = f"; the {before} before count as its start and are not judged" if before else ""
    return (
        f"{path.name} has no header and was read as GBOT's: times in ms, frames "
        f"{predictions[0].frame_index} to {predictions[-1].frame_index}{given}"
    )


def _noted(
    path: Path,
    rows: Rows[CsvRow],
    predictions: Rows[FramePrediction],
    sequence: Sequence,
    *,
    is_bop: bool,
) -> dict[str, object]:
    """What a config says of how its csv was read: what GBOT's layout means, and what is unusual."""
    notes = [] if is_bop else [_told_gbot(path, predictions, sequence)]
    found: dict[str, object] = {}
    covered, frames = len({row.frame for row in rows}), len(predictions)
    if covered < _MANY_WITH_ROWS * frames:
        found[FRAMES_WITH_ROWS] = covered
        notes = [*notes, f"only {covered} of {frames} frames have rows; the others have no pose"]
    repeats = sum(row.is_found for row in rows) - sum(len(p.poses) for p in predictions)
    if repeats:
        told = (
            f"{counted(repeats, 'row')} too many: a part has several in a frame (or a number more than "
            "it has copies), and the one with the best score counts, the first if they are equal"
        )
        notes = [*notes, told]
    return {**found, NOTES: notes} if notes else found


def _predictions(
    rows: Rows[CsvRow], sequence: Sequence, assembly: Assembly, path: Path, *, is_bop: bool
) -> tuple[FramePrediction, ...]:
    frames = set(sequence.frame_indices)
    outside = sorted({row.frame for row in rows} - frames)
    if outside:
        raise RunError(
            f"{path} has rows for frame {outside[0]}, which {sequence.name} does not have; "
            "is it the result of another scene?"
        )
    best = rows_by_frame(rows, assembly)
    start, spread = min(sequence.frame_indices if is_bop else best), _spread(rows)
    return tuple(
        _prediction(i, best.get(i, {}), spread) for i in sequence.frame_indices if i >= start
    )


def _prediction(
    index: int, rows: dict[str, CsvRow], spread: tuple[float, float]
) -> FramePrediction:
    found = {name: row for name, row in rows.items() if row.is_found}
    seconds = [row.seconds for row in found.values() if row.seconds is not None]
    return FramePrediction(
        frame_index=index,
        poses={
            name: PoseEstimate(
                part=name,
                T_camera_part=row.T_camera_part,
                score=_share(row.score, spread),
                stage="csv",
            )
            for name, row in found.items()
        },
        state=None,
        # Both formats repeat the time of the whole image in each of its rows.
        runtime={"total": max(seconds)} if seconds else {},
        not_found={name: row.T_camera_part for name, row in rows.items() if not row.is_found},
    )


def _spread(rows: Rows[CsvRow]) -> tuple[float, float]:
    """The range of the scores; 0 to 1 where all of them, or all but those not given, lie in it."""
    scores = [row.score for row in rows if row.is_found]
    if all(0 <= score <= 1 or score == NO_SCORE for score in scores):
        return 0.0, 1.0
    return min(scores), max(scores)


def _share(score: float, spread: tuple[float, float]) -> float:
    """A score of any range as one of 0 to 1, in the same order."""
    low, high = spread
    if (low, high) == (0.0, 1.0):
        return 1.0 if score == NO_SCORE else score
    return (score - low) / (high - low) if high > low else 1.0
