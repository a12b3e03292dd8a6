from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asdfviz.data import kept_arrays as module
from asdfviz.data.kept_arrays import kept_arrays, user_cache_folder

ARRAYS = {"a": np.array([[0.1, -0.0], [np.nan, 1e-300]]), "n": np.arange(3, dtype=np.int32)}


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return user_cache_folder("kind")


def not_made() -> dict[str, np.ndarray]:
    raise AssertionError("made again")


def same(found: dict[str, np.ndarray]) -> bool:
    return found.keys() == ARRAYS.keys() and all(
        found[k].dtype == ARRAYS[k].dtype and found[k].tobytes() == ARRAYS[k].tobytes()
        for k in ARRAYS
    )


def test_what_is_kept_is_read_back_to_the_last_bit(cache: Path) -> None:
    assert same(kept_arrays("kind", "name", lambda: ARRAYS))
    assert [file.name for file in cache.iterdir()] == ["name.npz"]
    assert same(kept_arrays("kind", "name", not_made))


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 broken"])
def test_a_broken_file_is_made_anew(cache: Path, content: bytes) -> None:
    cache.mkdir(parents=True)
    (cache / "name.npz").write_bytes(content)
    assert same(kept_arrays("kind", "name", lambda: ARRAYS))
    assert same(kept_arrays("kind", "name", not_made))


def test_a_changed_byte_is_seen(cache: Path) -> None:
    kept_arrays("kind", "name", lambda: ARRAYS)
    packed = bytearray((cache / "name.npz").read_bytes())
    packed[packed.index(ARRAYS["n"].tobytes())] ^= 1
    (cache / "name.npz").write_bytes(packed)
    assert same(kept_arrays("kind", "name", lambda: ARRAYS))


def test_nothing_needs_to_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, data: bytes) -> None:
        raise PermissionError(path)

    monkeypatch.setattr(module, "write_bytes", refuse)
    assert same(kept_arrays("kind", "name", lambda: ARRAYS))

    def homeless() -> Path:
        raise RuntimeError("no home")

    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setattr(Path, "home", homeless)
    assert same(kept_arrays("kind", "name", lambda: ARRAYS))
