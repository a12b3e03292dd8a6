"""Loads the runs that are named to be shown on a sequence; refuses those that are of another one."""

from __future__ import annotations

from pathlib import Path

from asdfviz.annotate.identity import sequence_identity
from asdfviz.data.folder_sequence import FolderSequence
from asdfviz.data.hashes import sequence_sha256
from asdfviz.data.result_csv import load_run_or_csv
from asdfviz.data.run_files import RUNS
from asdfviz.data.run_frames import shared_frames
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Assembly, Run
from asdfviz.errors import InputError, RunError


def load_named_run(path: Path, *, sequence: FolderSequence, assembly: Assembly) -> Run:
    """Load a saved run, or a csv with results, to be shown on a sequence.

    A run tells on which folder it was made, and the hash of what lay there: a copy of the folder, or
    one that was moved, is still its sequence. One that tells nothing is believed, and so is one that
    lies in the sequence's own runs/.

    Raises:
        RunError: it cannot be read, does not fit the assembly, is of another sequence, or shares no
            frame with this one.
    """
    run = load_run_or_csv(path, sequence=sequence, assembly=assembly)
    scene = Path(sequence.path)
    if (scene / RUNS).resolve() not in path.resolve().parents and not _is_of(run, sequence):
        raise RunError(
            f"{path} is a run on another sequence, {run.sequence}, not on {scene}: open that one, or "
            f"put the run into {scene / RUNS} if both are one recording"
        )
    if run.predictions:
        shared_frames(run, sequence.frame_indices, source=path, other=scene)
    return run


def _is_of(run: Run, sequence: FolderSequence) -> bool:
    """Whether a run is of a sequence, as far as it tells: by its folder, else by what lies in it."""
    folder, scene = Path(run.sequence), Path(sequence.path)
    if folder.resolve() == scene.resolve():
        return True
    recorded = run.hashes.get("sequence")
    if recorded is not None and recorded == sequence_sha256(scene):
        return True
    try:  # a copy to which a truth was added is another one by its hash
        there = open_sequence(folder, assembly=sequence.assembly)
        return sequence_identity(there) == sequence_identity(sequence)
    except InputError:  # gone, or no longer what it was
        return recorded is None
