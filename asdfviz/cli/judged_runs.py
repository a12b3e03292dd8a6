"""What `tables` and `ablate` share: a method run on a scene under a progress bar, judged, kept or not."""

from __future__ import annotations

import dataclasses
import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from asdfviz.cli.progress import progress_bar, stop_on_interrupt
from asdfviz.errors import InputError, RunError, Stopped

if TYPE_CHECKING:
    from asdfviz.data.folder_sequence import FolderSequence
    from asdfviz.datatypes import Assembly, FrameTruth, Run
    from asdfviz.evaluate.judgement import Judgement
    from asdfviz.evaluate.paper_layout import Layout
    from asdfviz.methods.spec import MethodSpec

WEIGHTS = ("weights", "masks")
"""Options that name files whose content a run's hashes have."""


@dataclass(frozen=True, slots=True, eq=False)
class MadeRun:
    """One method with one kind of first pose on one sequence."""

    run: Run
    config: object
    first_pose: str | None
    """None: the method starts from no detector's poses."""
    sequence: FolderSequence


def known_assembly(sequence: FolderSequence, option: str) -> Assembly:
    """The assembly of a scene.

    Raises:
        InputError: it names none; says which option helps.
    """
    if sequence.assembly is None:
        raise InputError(f"{sequence.path} does not name its assembly: give {option}")
    return sequence.assembly


def known_truth(sequence: FolderSequence, assembly: Assembly) -> dict[int, FrameTruth]:
    """The truth of a scene.

    Raises:
        InputError: there is none.
    """
    from asdfviz.data.sequences import read_folder_truth

    truth = read_folder_truth(Path(sequence.path), assembly)
    if not truth:
        raise InputError(f"{sequence.path} has no truth (scene_gt.json) to be judged by")
    return truth


def made_run(
    spec: MethodSpec, sequence: FolderSequence, config: object, *, title: str, if_stopped: str
) -> Run:
    """Run a method over a scene; `if_stopped` says what becomes of the runs before it.

    Raises:
        Stopped: by the user, before the last frame.
    """
    from asdfviz.run import run

    with progress_bar(title) as report, stop_on_interrupt() as stop:
        result = run(
            spec,
            sequence,
            config=config,
            progress=lambda done, total, _: report(done, total, ""),
            stop=stop,
            prepare=lambda done, total: report(done, total, "views of the parts, once"),
        )
    if len(result.predictions) < len(sequence):
        raise Stopped(if_stopped)
    return result


def kept_run(folder: Path, sequence: FolderSequence, config: object) -> Run | None:
    """The run in a folder if it is whole, of this version, these inputs and this config; else None.

    Weights are the same wherever they lie: their content tells.
    """
    from asdfviz import __version__
    from asdfviz.data.run_files import load_run
    from asdfviz.run import input_hashes, resolved_config

    assembly = sequence.assembly
    if assembly is None:
        return None
    try:
        kept = load_run(folder)
    except RunError:  # none, or one that cannot be read: it is made anew
        return None
    if kept.version != __version__:  # which might say something else of the same frames
        return None
    wanted = dataclasses.asdict(resolved_config(config, assembly))
    if len(kept.predictions) != len(sequence) or _plain(kept.config) != _plain(wanted):
        return None
    return kept if kept.hashes == input_hashes(sequence, assembly, config) else None


def judged(run: Run, sequence: FolderSequence, *, option: str) -> Judgement:
    """Judge a run against its scene's own truth."""
    from asdfviz.evaluate.bop import views_of
    from asdfviz.evaluate.evaluate import judge

    assembly = known_assembly(sequence, option)
    truth = known_truth(sequence, assembly)
    return judge(run, assembly=assembly, truth=truth, views=views_of(sequence))


def layout_for(out: Path | None) -> Layout:
    """The layout of a table, whose file is tried before hours go into what belongs there.

    Raises:
        InputError: nothing can be written there, or its ending stands for no layout.
    """
    from asdfviz.data.atomic import make_folder
    from asdfviz.evaluate.paper_layout import layout_of

    layout = layout_of(out)
    if out is not None:
        if out.is_dir():
            raise InputError(f"{out} is a folder: name a file for the table")
        make_folder(out.absolute().parent)
    return layout


def give_table(table: str, note: str, out: Path | None) -> None:
    """Write or print a table, and what its columns are."""
    from asdfviz.data.atomic import write_text

    if out is None:
        print(table)
    else:
        write_text(out, table + "\n")
        print(out)
    print(note, file=sys.stderr)


def _plain(config: object) -> object:
    """A config as its file holds it, without the files of weights."""
    return json.loads(json.dumps(config, default=str), object_hook=_without_weights)


def _without_weights(options: dict[str, Any]) -> dict[str, Any]:
    """`translation.weights` is a kind of weights, no file, and stays."""
    files = {k for k in WEIGHTS if isinstance(options.get(k), str) and Path(options[k]).suffix}
    return {key: value for key, value in options.items() if key not in files}
