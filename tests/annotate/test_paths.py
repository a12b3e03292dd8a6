"""File names that never leave the annotations folder and never meet."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from asdfviz.annotate.paths import annotation_file, annotations_folder

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", ["sample", "clip_01", "2024-05-01.take2"])
def test_a_plain_name_stays(name: str, tmp_path: Path) -> None:
    assert annotation_file(name, folder=tmp_path) == tmp_path / f"{name}.db"


NASTY = [
    "../../etc/passwd",
    "/abs",
    "..",
    ".",
    "",
    ".hidden",
    "a/b",
    "a\\b",
    "a:b",
    "ä ö",
    "x" * 400,
]


@pytest.mark.parametrize("name", [*NASTY, "a\0b", "con\n", "~", "$(ls)", "a?b#c"])
def test_no_name_leaves_the_folder(name: str, tmp_path: Path) -> None:
    file = annotation_file(name, folder=tmp_path)
    assert file.parent == tmp_path
    assert file.resolve().parent == tmp_path.resolve()
    assert not file.name.startswith(".")
    assert len(file.name) < 128
    file.touch()


def test_different_names_have_different_files(tmp_path: Path) -> None:
    names = [*NASTY, "a_b", "abs", "hidden", "x" * 100, "sequence"]
    assert len({annotation_file(name, folder=tmp_path) for name in names}) == len(names)


def test_a_clone_keeps_them_at_its_top(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    assert annotations_folder() == ROOT / "annotations"
    assert annotation_file("sample") == ROOT / "annotations" / "sample.db"


def test_an_installed_package_uses_the_working_folder(tmp_path: Path) -> None:
    target = tmp_path / "site" / "asdfviz"
    (target / "annotate").mkdir(parents=True)
    for name in ("__init__.py", "annotate/__init__.py", "annotate/paths.py"):
        (target / name).write_bytes((ROOT / "asdfviz" / name).read_bytes())
    code = "from asdfviz.annotate.paths import annotations_folder; print(annotations_folder())"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={"PYTHONPATH": str(tmp_path / "site")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert Path(done.stdout.strip()) == tmp_path / "annotations"
