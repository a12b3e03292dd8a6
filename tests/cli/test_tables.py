from __future__ import annotations

from pathlib import Path

import pytest

from asdfviz.cli.tables import Tables, as_published, condition_folders
from asdfviz.errors import InputError
from asdfviz.methods.registry import find_method


def test_only_the_four_conditions_are_taken(tmp_path: Path) -> None:
    for name in ("clamp/normal/rgb", "clamp/table1/rgb", "vise/hand/rgb", "vise/blur"):
        (tmp_path / name).mkdir(parents=True)
    found = [folder.relative_to(tmp_path).as_posix() for folder in condition_folders(tmp_path)]
    assert found == ["clamp/normal", "vise/hand"]


def test_a_folder_without_sets_and_a_wrong_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="asdfviz synth testset"):
        condition_folders(tmp_path)
    with pytest.raises(InputError, match=r"\.md, \.csv or \.tex"):
        Tables("gbot", tmp_path, out=tmp_path / "table.pdf")()


@pytest.mark.parametrize("name", ["icg", "gbot"])
def test_the_papers_trackers_say_all_their_poses(name: str) -> None:
    spec = find_method(name)
    assert vars(spec.config())["report_lost"] is False
    config = as_published(spec)
    assert isinstance(config, spec.config)
    assert vars(config)["report_lost"] is True


def test_a_method_that_knows_no_loss_runs_as_it_is() -> None:
    spec = find_method("asdf")
    assert as_published(spec) == spec.config()
