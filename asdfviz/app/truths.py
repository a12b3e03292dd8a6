"""Truths with the corrections in them: what runs are judged by, and what is drawn and exported."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from asdfviz.annotate.checked import Checked, checked_truth
from asdfviz.annotate.corrected import corrected_truth, run_of_seed
from asdfviz.app.view import TRUTH
from asdfviz.app.workspace import Workspace
from asdfviz.data.run_files import is_unfilled
from asdfviz.datatypes import FrameTruth, Run
from asdfviz.errors import AnnotationError


def truth_of(workspace: Workspace) -> dict[int, FrameTruth]:
    """What runs are judged by: the dataset's own truth with every correction.

    Raises:
        AnnotationError: there is neither.
    """
    truth = corrected_truth(
        workspace.store,
        _own_truth(workspace),
        assembly=workspace.assembly,
        frames=workspace.indices,
    )
    if not truth:
        raise AnnotationError(
            f"{workspace.frames.name} has no truth to judge by: correct some frames first"
        )
    return truth


def drawn_truth(workspace: Workspace, base: str | None) -> dict[int, FrameTruth]:
    """Poses and states as they are drawn: what corrections started from, with every correction."""
    chosen = workspace.base_of_seed() or base
    run = workspace.run(chosen)
    start: Mapping[int, FrameTruth] | Run = {}
    if run is not None:
        start = run.run
    elif chosen == TRUTH:
        start = _own_truth(workspace)
    return corrected_truth(
        workspace.store, start, assembly=workspace.assembly, frames=workspace.indices
    )


def exported_truth(workspace: Workspace, base: str | None, *, guesses: bool) -> Checked:
    """What is drawn, where that is what corrections started from.

    Args:
        workspace: the sequence and its corrections.
        base: the run, or the truth, that is drawn where nothing was corrected.
        guesses: whether what nobody checked of a run's is meant, too.

    Raises:
        AnnotationError: what corrections started from is not here, or nothing was checked.
    """
    lost = lost_base(workspace)
    if lost is not None:
        raise AnnotationError(lost)
    drawn = drawn_truth(workspace, base)
    if guesses or workspace.run(workspace.base_of_seed() or base) is None:
        return Checked(drawn)
    checked = checked_truth(workspace.store, drawn, workspace.assembly)
    if not checked.truth:
        raise AnnotationError(
            "nothing is exported: nobody set, tracked or verified a pose, or set a state; correct "
            "some frames first, or export unchecked ones, too"
        )
    return checked


def lost_base(workspace: Workspace) -> str | None:
    """What to say where corrections started from something that is not here; None where it is."""
    seed = workspace.store.seed()
    if seed.kind == "none" or workspace.base_of_seed() is not None:
        return None
    what = "its own truth" if seed.kind == "truth" else f"the run {seed.run or seed.method}"
    way = "cannot be read: bring it back and open the sequence again"
    if unfinished_seed(workspace) is not None:
        way = f"was never saved: run {seed.method} again, which takes its place"
    return (
        f"the corrections of {workspace.frames.name} started from {what}, which {way}, or press "
        "'use' at another run or the truth in the Methods tab to go on from it; nothing is "
        "exported before"
    )


def unfinished_seed(workspace: Workspace) -> Path | None:
    """The folder of the run that corrections started from, if it was never saved and may be yet.

    So it is when the app was killed while a method worked whose poses were corrected meanwhile.
    """
    seed = workspace.store.seed()
    if seed.run is None or workspace.base_of_seed() is not None:
        return None
    folder = run_of_seed(seed.run, workspace.frames.source)
    is_ours = folder.resolve().parent == workspace.runs_folder.resolve()
    return folder if is_ours and is_unfilled(folder) else None


def _own_truth(workspace: Workspace) -> dict[int, FrameTruth]:
    """What the dataset itself says, by frame number."""
    return {t.frame_index: t for t in workspace.truths if t is not None}
