"""Tells whose layout a csv of results has: BOP's or the GBOT evaluator's. Guesses nothing.

BOP's is told by its header. GBOT's has none, calls objects by name and writes -1 for every score; what
has no header and is not like that may be BOP's without its first line, so it is refused: the two differ
in the unit of time and in whether the frames before the first row count.
"""

from __future__ import annotations

import csv
from pathlib import Path

from asdfviz.errors import RunError, counted, some

COLUMNS = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
"""BOP's header; GBOT's columns mean the same."""
NO_SCORE = -1.0
"""Says that the method gives no score."""

_HEADER = ",".join(COLUMNS)


def read_lines(path: Path) -> tuple[list[list[str]], bool]:
    """The lines of a csv, a header among them, and whether it is BOP's (else GBOT's).

    Raises:
        RunError: it cannot be read, holds no results, or is neither.
    """
    lines = _lines(path)
    first = [cell.strip() for cell in lines[0]]
    if [cell.lower() for cell in first] == [name.lower() for name in COLUMNS]:
        if not lines[1:]:
            raise RunError(f"{path} has a header, but no rows with results")
        return lines, True
    if not any(map(_is_numeric, (first[1], *first[3:]))):
        strange = [cell for cell in first if cell.lower() not in _HEADER.lower().split(",")]
        what = f"names {some(strange)}" if strange else "has another order"
        raise RunError(f"{path} line 1 is a header, but {what}; the one that is known is {_HEADER}")
    scored = [cells for cells in lines if _is_numeric(cells[3]) and float(cells[3]) != NO_SCORE]
    if scored or all(_is_numeric(cells[2]) for cells in lines):
        what = f"the score {scored[0][3].strip()}" if scored else "all objects by number"
        raise RunError(
            f"{path} has no header but {what}, and GBOT's rows have names and the score -1: if these "
            f"are BOP's (time in seconds), put {_HEADER} as the first line"
        )
    return lines, False


def _lines(path: Path) -> list[list[str]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = [cells for cells in csv.reader(file) if cells]
    except FileNotFoundError as error:
        raise RunError(f"there is no file {path}") from error
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RunError(f"{path} cannot be read as csv: {error}") from error
    if not lines:
        raise RunError(f"{path} is empty; it needs rows of {', '.join(COLUMNS)}")
    for number, cells in enumerate(lines, start=1):
        if len(cells) != len(COLUMNS):
            raise RunError(
                f"{path} line {number}: {counted(len(cells), 'column')}, expected "
                f"{', '.join(COLUMNS)}{_other_separator(cells)}"
            )
    return lines


def _other_separator(cells: list[str]) -> str:
    """What parts a line's columns where commas do not, as spreadsheets of some languages write them."""
    text = ",".join(cells)
    for mark, name in ((";", "semicolons"), ("\t", "tabs")):
        if len(text.split(mark)) == len(COLUMNS):
            return f"; its columns stand between {name}: put commas there, and points in decimals"
    return ""


def _is_numeric(cell: str) -> bool:
    """Whether it begins with a number, one or several."""
    try:
        float(cell.split()[0])
    except (IndexError, ValueError):
        return False
    return True
