"""A name that no file could hold is refused before any work."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from asdfviz.data.assembly import find_assembly
from asdfviz.data.atomic import make_folder
from asdfviz.data.path_names import check_name
from asdfviz.data.sequences import open_sequence
from asdfviz.errors import AssemblyError, InputError, SequenceError


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with a name that is not UTF-8, as old archives unpack them."""
    folder = tmp_path / os.fsdecode(b"sur\xff")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("the file system takes UTF-8 names only")
    return folder


def test_any_text_is_a_name(tmp_path: Path) -> None:
    check_name(tmp_path / "Größe 測 <b>")


@pytest.mark.parametrize(
    ("use", "error"),
    [(open_sequence, SequenceError), (find_assembly, AssemblyError), (make_folder, InputError)],
)
@pytest.mark.parametrize("below", [".", "inner"])
def test_a_name_that_is_no_text_is_refused(
    folder: Path, use: Callable[[Path], object], error: type[InputError], below: str
) -> None:
    inner = folder / below
    inner.mkdir(exist_ok=True)
    (inner / "assembly.yaml").touch()
    with pytest.raises(error, match=r"the name 'sur\\udcff' is not UTF-8.*give it another"):
        use(inner)
    assert [path.name for path in inner.iterdir() if path.is_file()] == ["assembly.yaml"]
