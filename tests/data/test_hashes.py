from __future__ import annotations

from pathlib import Path

from asdfviz.data.hashes import file_sha256, sequence_sha256

EMPTY = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"


def test_a_files_hash_is_sha256(tmp_path: Path) -> None:
    file = tmp_path / "empty"
    file.write_bytes(b"")
    assert file_sha256(file) == EMPTY
    file.write_bytes(b"full")
    assert file_sha256(file) != EMPTY


def test_a_scenes_hash_follows_names_and_contents(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name / "rgb").mkdir(parents=True)
        (tmp_path / name / "rgb" / "0.png").write_bytes(b"image")
    same = sequence_sha256(tmp_path / "one")
    assert same == sequence_sha256(tmp_path / "two")
    (tmp_path / "one" / "notes.txt").write_text("results beside the scene do not count")
    assert sequence_sha256(tmp_path / "one") == same
    (tmp_path / "two" / "rgb" / "0.png").write_bytes(b"other")
    assert sequence_sha256(tmp_path / "two") != same
    (tmp_path / "one" / "rgb" / "0.png").rename(tmp_path / "one" / "rgb" / "1.png")
    assert sequence_sha256(tmp_path / "one") != same
