"""The tiny sequence in a workspace, so that the app's logic runs without a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from hand_edits import JAW, Do
from tiny_sequence import TinySequence, make_run

from asdfviz.annotate.store import AnnotationStore
from asdfviz.app.desk import Burst, Done
from asdfviz.app.editing import Edits, apply_edit
from asdfviz.app.view import View
from asdfviz.app.workspace import Workspace
from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly


@pytest.fixture(scope="session")
def clamp() -> Assembly:
    return load_assembly("corner_clamp")


@pytest.fixture
def workspace(clamp: Assembly, tmp_path: Path) -> Iterator[Workspace]:
    store = AnnotationStore(
        tmp_path / "tiny.db", sequence_name="tiny", assembly_name=clamp.name, author="ann"
    )
    made = Workspace(
        TinySequence(clamp, tmp_path),
        clamp,
        store=store,
        runs_folder=tmp_path / "runs",
        export_folder=tmp_path / "export",
    )
    yield made
    made.close()


@pytest.fixture
def with_run(workspace: Workspace, clamp: Assembly) -> Workspace:
    workspace.put_run(make_run(clamp), "first")
    return workspace


@pytest.fixture
def do(with_run: Workspace) -> Do:
    """Edits of the clamp, whose run says state 0, 0, 0, 1, none, 1, 2, 2."""

    def run(action: Edits, view: View = JAW, *, now: float = 0.0) -> Done:
        return apply_edit(action, view, with_run, burst=Burst(), now=now)

    return run
