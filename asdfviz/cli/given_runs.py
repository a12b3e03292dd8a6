"""Runs and results made elsewhere as further rows of `asdfviz tables`: of which scenes, under which name."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from asdfviz.cli.judged_runs import judged, known_assembly
from asdfviz.errors import RunError, some

if TYPE_CHECKING:
    from asdfviz.data.folder_sequence import FolderSequence
    from asdfviz.datatypes import Run
    from asdfviz.evaluate.judgement import Judgement


@dataclass(frozen=True)
class GivenRun:
    """One of them on one scene, judged."""

    run: Run
    """Its method is called as the row is."""
    sequence: FolderSequence
    found: Judgement


def given_runs(
    paths: Sequence[Path], sequences: Sequence[FolderSequence], *, taken: Collection[str]
) -> list[GivenRun]:
    """Load and judge runs on the scenes of a table; what makes their figures doubtful goes to stderr.

    Args:
        paths: run folders, or csv files, which may hold rows of several scenes.
        sequences: scenes of the table.
        taken: methods that have rows of their own.

    Raises:
        InputError: one cannot be read, is of no scene of the table, or does not fit it.
    """
    from asdfviz.evaluate.inputs import changed_inputs, run_names

    loaded = [(path, *one) for path in paths for one in _loaded(path, sequences)]
    names = run_names([(path, run) for path, run, _ in loaded], taken=taken)
    given: list[GivenRun] = []
    for (_, run, sequence), name in zip(loaded, names, strict=True):
        named = dataclasses.replace(run, method=name)
        found = judged(named, sequence, option="--models")
        changed = changed_inputs(run, known_assembly(sequence, "--models"))
        for warning in (*found.warnings, *changed):
            print(f"warning: {name} on {sequence.path}: {warning}", file=sys.stderr)
        given.append(GivenRun(named, sequence, found))
    return given


def _loaded(path: Path, sequences: Sequence[FolderSequence]) -> list[tuple[Run, FolderSequence]]:
    from asdfviz.data.run_files import check_fits, load_run

    if path.is_file() or (path.suffix.lower() == ".csv" and not path.exists()):
        return _from_csv(path, sequences)
    run = load_run(path)
    about = Path(run.sequence).resolve()
    sequence = next((one for one in sequences if Path(one.path).resolve() == about), None)
    if sequence is None:
        raise RunError(
            f"{path} is a run on {run.sequence}, which is no scene of this table; it has "
            f"{_listed(sequences)}"
        )
    check_fits(run.predictions, known_assembly(sequence, "--models"), path)
    return [(dataclasses.replace(run, sequence=sequence.path), sequence)]


def _from_csv(path: Path, sequences: Sequence[FolderSequence]) -> list[tuple[Run, FolderSequence]]:
    """A run for each scene that the csv names; else one for the scene in whose folder it lies."""
    from asdfviz.data.result_csv import read_result_csv, scenes_in

    known, scenes = _names_of(sequences), scenes_in(path)
    named: list[tuple[str | None, FolderSequence]] = [
        (scene, known[scene]) for scene in scenes if scene in known
    ]
    if not named:
        above = path.resolve().parents
        named = [(None, one) for one in sequences if Path(one.path).resolve() in above]
    elif len(named) < len(scenes):
        others = some(scene for scene in scenes if scene not in known)
        print(f"warning: {path}: scenes that are not of this table: {others}", file=sys.stderr)
    if not named:
        raise RunError(
            f"{path} has rows of the scene {some(scenes)}, which is none of this table: call it as "
            f"here ({_listed(sequences)}) in the first column, or put the csv into its folder"
        )
    return [
        (
            read_result_csv(
                path,
                sequence=sequence,
                assembly=known_assembly(sequence, "--models"),
                scene=scene,
            ),
            sequence,
        )
        for scene, sequence in named
    ]


def _names_of(sequences: Sequence[FolderSequence]) -> dict[str, FolderSequence]:
    """What a csv may call each scene: assembly/set, or one of the two where that tells them apart."""
    named: dict[str, list[FolderSequence]] = {}
    for one in sequences:
        folder = Path(one.path)
        for name in (_full_name(one), folder.name, folder.parent.name):
            named.setdefault(name, []).append(one)
    return {name: those[0] for name, those in named.items() if len(those) == 1}


def _listed(sequences: Sequence[FolderSequence]) -> str:
    return some(_full_name(one) for one in sequences)


def _full_name(sequence: FolderSequence) -> str:
    return "/".join(Path(sequence.path).parts[-2:])
