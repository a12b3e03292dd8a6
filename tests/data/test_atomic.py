from __future__ import annotations

import os
from pathlib import Path

import pytest

from asdfviz.data.atomic import make_folder, write_bytes, write_text
from asdfviz.errors import InputError


def test_makes_the_folder_and_replaces_the_old_content(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b.txt"
    write_text(path, "old")
    write_text(path, "Größe")
    assert path.read_bytes() == "Größe".encode()
    assert [p.name for p in path.parent.iterdir()] == ["b.txt"]


def test_a_failure_leaves_the_old_content_and_no_rubbish(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "b.bin"
    write_bytes(path, b"old")

    def full(_: int) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="no space"):
        write_bytes(path, b"new")
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["b.bin"]


def test_a_folder_for_results_is_made_and_left_as_it_was(tmp_path: Path) -> None:
    make_folder(tmp_path / "a" / "b")
    assert list((tmp_path / "a" / "b").iterdir()) == []
    write_text(tmp_path / "a" / "old.txt", "old")
    make_folder(tmp_path / "a")
    assert (tmp_path / "a" / "old.txt").read_text() == "old"


@pytest.mark.parametrize("below", [".", "run", "run/1"])
def test_a_file_in_the_way_is_named_before_the_work_starts(tmp_path: Path, below: str) -> None:
    file = tmp_path / "notes.txt"
    file.write_text("mine")
    with pytest.raises(InputError, match=r"notes\.txt is a file; results need a folder"):
        make_folder(file / below)
    assert file.read_text() == "mine"


def test_a_folder_that_takes_no_files_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(path: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "touch", refuse)
    with pytest.raises(InputError, match=r"cannot write into .*: Permission denied"):
        make_folder(tmp_path)
