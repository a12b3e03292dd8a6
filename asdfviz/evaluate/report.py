"""Writes several judged runs as one self-contained page: tables, curves, strips, worst frames.

The page loads nothing: style, drawings (SVG) and pictures (JPEG) stand in it, so it can be mailed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from asdfviz.data.assembly import load_assembly
from asdfviz.data.atomic import make_folder, write_text
from asdfviz.errors import RunError
from asdfviz.evaluate.inputs import open_result, refuse_csv_options, run_names, short_names
from asdfviz.evaluate.report_runs import JudgedRun, judged_run
from asdfviz.evaluate.report_sections import page
from asdfviz.evaluate.worst import SHOWN

PICTURES_BYTES = 1_600_000
"""JPEG bytes of all pictures together; base64 adds a third, and the page stays below 3 MB."""
_LARGEST_SHOT = 70_000


def write_report(
    paths: Sequence[Path],
    out: Path,
    *,
    truth_folder: Path | None = None,
    assembly: str | None = None,
    sequence: str | None = None,
    scene: str | None = None,
    pictures: int = SHOWN,
    progress: Callable[[int, int, str], None] | None = None,
) -> None:
    """Judge runs (folders or csv files) and write the page.

    Args:
        paths: what `asdfviz run` wrote, or csv files; see `open_result`.
        out: the page.
        truth_folder: as in `open_result`.
        assembly: name or path; None for what each run names.
        sequence: as in `open_result`; refused where all paths are folders.
        scene: likewise.
        pictures: worst frames shown of each run.
        progress: told how many runs are done, of how many, and which comes next.

    Raises:
        InputError: a run or its truth cannot be read.
        RenderError: pictures are wanted and nothing can be drawn here.
    """
    _check(paths, out, pictures)
    refuse_csv_options(paths, sequence=sequence, scene=scene)
    make_folder(out.absolute().parent)
    known = None if assembly is None else load_assembly(assembly)
    results = [
        open_result(path, truth_folder=truth_folder, assembly=known, sequence=sequence, scene=scene)
        for path in paths
    ]
    names = run_names([(result.source, result.run) for result in results])
    places = {name: place for place, name in enumerate(dict.fromkeys(names))}
    titles = short_names(list(dict.fromkeys(result.run.sequence for result in results)))
    share = min(PICTURES_BYTES // max(pictures * len(results), 1), _LARGEST_SHOT)
    judged: list[JudgedRun] = []
    for result, name in zip(results, names, strict=True):
        if progress is not None:
            progress(len(judged), len(results), name)
        judged.append(
            judged_run(
                result,
                name,
                place=places[name],
                sequence_name=titles[result.run.sequence],
                pictures=pictures,
                max_bytes=share,
            )
        )
    write_text(out, page(judged))
    if progress is not None:
        progress(len(results), len(results), "")


def _check(paths: Sequence[Path], out: Path, pictures: int) -> None:
    if not paths:
        raise RunError("name at least one run, as in: asdfviz report runs/asdf -o report.html")
    if out.suffix.lower() not in (".html", ".htm") or out.is_dir():
        raise RunError(f"the page is to be {out}: name a file that ends in .html")
    if pictures < 0:
        raise RunError(f"{pictures} pictures: use 0 or more")
