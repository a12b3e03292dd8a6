"""The tiny sequence in a workspace, so that the app's logic runs without a browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tiny_sequence import TinySequence, make_run

from asdfviz.annotate.store import AnnotationStore
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
