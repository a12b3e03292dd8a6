"""Gathers what a judgement needs from disk: a run (ours or a csv), its assembly, the truth, the frames."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from asdfviz.data.assembly import load_assembly
from asdfviz.data.folder_sequence import FolderSequence
from asdfviz.data.hashes import assembly_sha256, sequence_sha256
from asdfviz.data.result_csv import read_result_csv
from asdfviz.data.run_files import check_fits, load_run
from asdfviz.data.run_frames import shared_frames
from asdfviz.data.scene_objects import SCENE_GT, objects_beside
from asdfviz.data.sequences import open_sequence, read_folder_truth
from asdfviz.datatypes import Assembly, FrameTruth, Run
from asdfviz.errors import RunError, SequenceError
from asdfviz.evaluate.bop import View, Views, views_of


@dataclass(frozen=True)
class Result:
    """A run and what it is judged by."""

    source: Path
    """The run's folder or csv."""
    run: Run
    assembly: Assembly
    truth: dict[int, FrameTruth]

    @cached_property
    def sequence(self) -> FolderSequence:
        """The run's frames. Raises SequenceError if they are gone."""
        return open_sequence(self.run.sequence, assembly=self.assembly)

    @cached_property
    def _views(self) -> Views:
        return views_of(self.sequence)

    def view(self, frame_index: int) -> View:
        """Camera and measured depth of a frame; a frame without images has no depth."""
        return self._views(frame_index)


def open_result(
    path: Path,
    *,
    truth_folder: Path | None = None,
    assembly: Assembly | None = None,
    sequence: str | None = None,
    scene: str | None = None,
) -> Result:
    """Load a saved run, or a csv of BOP or GBOT, and its truth.

    Args:
        path: what `asdfviz run` wrote, or a csv file.
        truth_folder: holds scene_gt.json and states.json; None for the run's sequence.
        assembly: None for the one that the run or the sequence names.
        sequence: the frames that a csv is about; None for `truth_folder`. A folder has its own.
        scene: whose rows of a csv to take; None for those of the sequence's name, or the only ones.

    Raises:
        InputError: the run, its assembly or the truth cannot be read or do not fit.
    """
    if path.suffix.lower() == ".csv" and not path.exists():
        raise RunError(f"there is no file {path}")
    if path.is_file():
        run, assembly = _read_csv(path, sequence or truth_folder, assembly, scene)
    else:
        run = load_run(path)
        assembly = assembly_of(run, path) if assembly is None else assembly
        check_fits(run.predictions, assembly, path)
    return Result(path, run, assembly, _truth_for(run, path, truth_folder, assembly))


def refuse_csv_options(paths: Sequence[Path], *, sequence: str | None, scene: str | None) -> None:
    """See that what only a csv leaves open is not said of runs that hold it themselves.

    Raises:
        RunError: all are folders, and frames or a scene are named.
    """
    named = [
        option
        for option, value in (("--sequence", sequence), ("--scene", scene))
        if value is not None
    ]
    if named and paths and all(path.is_dir() for path in paths):
        raise RunError(
            f"{' and '.join(named)} {'is' if len(named) == 1 else 'are'} for csv files, and "
            f"{paths[0]} is a run folder, which knows its frames: use --truth for the folder with "
            "another truth to judge it by"
        )


def run_names(runs: Sequence[tuple[Path, Run]], *, taken: Collection[str] = ()) -> list[str]:
    """What runs are called beside each other: their methods, and their folders or files where needed.

    Args:
        runs: each with where it came from.
        taken: names of others; runs of one sequence and method are told apart as well.
    """
    keys = [(run.sequence, run.method) for _, run in runs]
    places = [os.path.abspath(source) for source, _ in runs]
    alike: dict[tuple[str, str], dict[str, None]] = {}
    for key, place in zip(keys, places, strict=True):
        alike.setdefault(key, {})[place] = None
    told = {key: short_names(list(those)) for key, those in alike.items()}
    return [
        run.method
        if len(told[key]) == 1 and run.method not in taken
        else f"{run.method} ({told[key][place]})"
        for (_, run), key, place in zip(runs, keys, places, strict=True)
    ]


def short_names(paths: Sequence[str]) -> dict[str, str]:
    """Each path's last folders, as few as tell all paths apart."""
    most = max((len(Path(path).parts) for path in paths), default=1)
    for count in range(1, most + 1):
        names = {path: "/".join(Path(path).parts[-count:]) for path in paths}
        if len(set(names.values())) == len(paths):
            return names
    return {path: path for path in paths}


def changed_inputs(run: Run, assembly: Assembly) -> list[str]:
    """Say which inputs of the run are no longer what they were; a run without hashes is believed."""
    found: list[str] = []
    if run.hashes.get("assembly") not in (None, assembly_sha256(assembly)):
        found.append(f"{run.assembly} or a mesh of it changed since the run")
    folder = Path(run.sequence)
    if folder.is_dir() and run.hashes.get("sequence") not in (None, sequence_sha256(folder)):
        found.append(f"images or JSON files of {folder} changed since the run")
    return found


def unknown_objects(folder: Path, assembly: Assembly) -> list[str]:
    """Name the objects of a truth that are not judged because the assembly has no such part.

    Raises:
        SequenceError: scene_gt.json is broken.
    """
    strangers, _ = objects_beside(folder, assembly)
    if not strangers:
        return []
    named = ", ".join(f"'{name}'" for name in strangers)
    return [
        f"{folder / SCENE_GT} has {sum(strangers.values())} entries of {named}, which {assembly.name} "
        "does not have: they count as distractors and are not judged. If one is a part, give it the "
        "part's name or 'obj_id'"
    ]


def _read_csv(
    path: Path, frames: str | Path | None, assembly: Assembly | None, scene: str | None
) -> tuple[Run, Assembly]:
    if frames is None:
        raise RunError(f"{path} does not say which frames it is about; name them with --sequence")
    sequence = open_sequence(frames, assembly=assembly)
    if sequence.assembly is None:
        raise RunError(f"{sequence.path} names no assembly for {path}; name it with --assembly")
    run = read_result_csv(path, sequence=sequence, assembly=sequence.assembly, scene=scene)
    return run, sequence.assembly


def assembly_of(run: Run, run_folder: Path) -> Assembly:
    """Load the assembly that a run names.

    Raises:
        RunError: it is gone.
        AssemblyError: it is broken.
    """
    if not Path(run.assembly).is_file():
        raise RunError(
            f"{run_folder}: its assembly {run.assembly} is gone; say where it is with --assembly"
        )
    return load_assembly(run.assembly)


def _truth_for(
    run: Run, run_folder: Path, truth_folder: Path | None, assembly: Assembly
) -> dict[int, FrameTruth]:
    folder = Path(run.sequence) if truth_folder is None else truth_folder
    if not folder.is_dir():
        whose = "its sequence" if truth_folder is None else "the truth"
        raise SequenceError(
            f"{run_folder}: {whose} {folder} is no folder; say with --truth where scene_gt.json and "
            "states.json are"
        )
    try:
        truth = read_folder_truth(folder, assembly)
    except SequenceError as error:
        raise SequenceError(
            f"{error} (it is the truth that {run_folder}, a run of {assembly.name}, is judged by)"
        ) from error
    if not truth:
        raise SequenceError(
            f"{folder} holds no truth to judge {run_folder} by: scene_gt.json or states.json is needed; "
            "without it `asdfviz agree` compares the poses with the measured depth"
        )
    if run.predictions:
        shared_frames(run, truth, source=run_folder, other=f"the truth of {folder}")
    return truth
