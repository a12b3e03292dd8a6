"""Shape checks for the whole package, and the data folder that only some machines have."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import jaxtyping
import pytest
import shape_checks
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

# Modules imported from here on check their jaxtyping annotations at every call.
shape_checks.install("asdfviz")

FIRST = (
    "test_carrying.py",
    "test_wheel.py",
    "test_sequence_physics.py",
    "test_browser_reload.py",
    "test_kit.py",
    "test_training.py",
    "test_crop_training.py",
    "test_fresh.py",
)
"""Begun first, in this order: one process compiles the tracker's loops for all while others do what
needs none, and none waits at the end for files with minutes of work in few tests."""
REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder with the paper's parts, real frames and reference outputs."""
    folder = Path(os.environ.get("ASDFVIZ_SHARED", REPOSITORY.parent / "shared"))
    if not (folder / "data").is_dir():
        pytest.skip(f"no shared data folder at {folder} (set ASDFVIZ_SHARED)")
    return folder


@pytest.fixture(scope="session")
def unchecked() -> Callable[[], AbstractContextManager[None]]:
    """Leaves shapes unchecked for a while: for long work on functions that shorter tests check."""

    @contextmanager
    def leave() -> Iterator[None]:
        jaxtyping.config.update("jaxtyping_disable", True)
        try:
            yield
        finally:
            jaxtyping.config.update("jaxtyping_disable", False)

    return leave


@pytest.fixture
def shapes_unchecked(unchecked: Callable[[], AbstractContextManager[None]]) -> Iterator[None]:
    """The same for a whole test; files of long ones use it as their mark."""
    with unchecked():
        yield


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Load all tests without looking for garbage, and never look among them again: all of it stays."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put some files first; all else keeps its order."""
    place = {name: i for i, name in enumerate(FIRST)}
    items.sort(key=lambda item: place.get(item.path.name, len(FIRST)))


@pytest.fixture(scope="session")
def another_file() -> Callable[[Path, Path], Path]:
    """Writes the network of one file to another, whose hash is another one."""

    def written(weights: Path, other: Path) -> Path:
        with safe_open(weights, framework="numpy") as file:
            metadata = {**file.metadata(), "written": "again"}
        save_file(load_file(weights), other, metadata=metadata)
        return other

    return written
