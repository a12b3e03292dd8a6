"""The rooms of the package import only downward, and heavy packages stay in their rooms."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from itertools import chain
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "asdfviz"
LAYERS = (
    ("geometry", "errors"),
    ("datatypes",),
    ("data", "render"),
    ("detector", "pose", "state", "track"),
    ("methods", "synth"),
    ("run", "train", "evaluate", "export", "annotate", "bench"),
    ("app",),
    ("cli",),
    ("__main__",),
)
RANK = {room: rank for rank, rooms in enumerate(LAYERS) for room in rooms}
ONLY_IN = {
    "torch": {"detector", "train", "synth"},
    "viser": {"app"},
    "pyrender": {"render"},
    "OpenGL": {"render"},
    "sqlite3": {"annotate"},
    "tyro": {"cli"},
    "manifold3d": {"synth", "data"},
}
DISTRIBUTION = {"PIL": "pillow", "cv2": "opencv-python-headless", "yaml": "pyyaml"}
"""Packages that go by other names where they are installed from."""


@cache
def nodes(file: Path) -> tuple[ast.AST, ...]:
    """What a file is made of, taken apart once for all tests."""
    return tuple(ast.walk(ast.parse(file.read_text())))


@cache
def imports(file: Path) -> tuple[tuple[str, ...], ...]:
    """Dotted names that a file imports, deferred imports too."""
    return tuple(_imports(file))


def _imports(file: Path) -> Iterator[tuple[str, ...]]:
    for node in nodes(file):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            module = tuple((node.module or "").split("."))
            yield module
            yield from ((*module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (tuple(alias.name.split(".")) for alias in node.names)


def files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def room_of(file: Path) -> str:
    return file.relative_to(PACKAGE).with_suffix("").parts[0]


def upward_imports(file: Path, room: str) -> list[str]:
    used = {name[1] for name in imports(file) if name[0] == "asdfviz" and len(name) > 1}
    return [
        other
        for other in sorted(used)
        if other != room and other in RANK and RANK[other] >= RANK[room]
    ]


@pytest.mark.parametrize("file", files(), ids=lambda file: str(file.relative_to(PACKAGE)))
def test_imports_point_downward(file: Path) -> None:
    room = room_of(file)
    if room == "__init__":
        return
    assert room in RANK, f"{room} has no layer: add it to LAYERS"
    assert upward_imports(file, room) == []


@pytest.mark.parametrize("file", files(), ids=lambda file: str(file.relative_to(PACKAGE)))
def test_heavy_packages_stay_in_their_rooms(file: Path) -> None:
    heavy = {name[0] for name in imports(file)} & set(ONLY_IN)
    assert {package for package in heavy if room_of(file) not in ONLY_IN[package]} == set()


def test_an_upward_import_is_seen(tmp_path: Path) -> None:
    file = tmp_path / "bad.py"
    file.write_text("from asdfviz.app.server import start\n")
    assert upward_imports(file, "data") == ["app"]


def test_every_package_that_is_imported_is_named_as_a_dependency() -> None:
    project = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text())["project"]
    extras = [v for k, v in project["optional-dependencies"].items() if k != "dev"]
    wanted = [re.split(r"[<>=\[]", one)[0] for one in chain(project["dependencies"], *extras)]
    imported = {name[0] for file in files() for name in imports(file)}
    foreign = imported - sys.stdlib_module_names - {"asdfviz", ""}
    assert {DISTRIBUTION.get(name, name) for name in foreign} - set(wanted) == set()


def test_files_and_functions_stay_short() -> None:
    long_files = [f"{f}: {n}" for f in files() if (n := len(f.read_text().splitlines())) > 300]
    assert long_files == []
    for file in files():
        for node in nodes(file):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                assert length <= 60, f"{file}:{node.lineno} {node.name} has {length} lines"
