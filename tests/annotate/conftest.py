"""A store on a fresh file, and an assembly of three boxes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from asdfviz.annotate.store import AnnotationStore
from asdfviz.datatypes import Assembly, Mesh, Part, State
from asdfviz.geometry.symmetry import Symmetries

OpenStore = Callable[..., AnnotationStore]


@pytest.fixture
def open_store(tmp_path: Path) -> Iterator[OpenStore]:
    """Opens any number of stores on one file; all are closed in the end."""
    stores: list[AnnotationStore] = []

    def open_one(
        author: str = "ada", *, sequence: str = "clip", assembly: str = "boxes"
    ) -> AnnotationStore:
        file = tmp_path / "notes" / "clip.db"
        stores.append(
            AnnotationStore(file, sequence_name=sequence, assembly_name=assembly, author=author)
        )
        return stores[-1]

    yield open_one
    for store in stores:
        store.close()


@pytest.fixture
def store(open_store: OpenStore) -> AnnotationStore:
    return open_store()


@pytest.fixture(scope="session")
def boxes() -> Assembly:
    vertices = np.array([[0.0, 0, 0], [0.04, 0, 0], [0, 0.02, 0], [0, 0, 0.01]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)
    parts = {
        name: Part(
            name=name,
            mesh=Mesh(vertices, faces),
            keypoints=np.resize(vertices, (17, 3)),
            symmetries=Symmetries(),
            diameter=0.05,
            color=np.zeros(3, dtype=np.uint8),
            detector_class=name,
        )
        for name in ("base", "lid", "pin")
    }
    identity = np.eye(4)
    states = (
        State(0, "bare", {"base": identity}),
        State(1, "closed", {"base": identity, "lid": identity}),
        State(2, "pinned", dict.fromkeys(parts, identity)),
        State(3, "lid wrong", {"base": identity, "lid": identity}, is_error=True, after=0),
    )
    return Assembly(
        "boxes",
        "Boxes",
        "base",
        parts,
        states,
        frozenset({(0, 1), (1, 2)}),
        tuple(parts),
        "/b.yaml",
    )
