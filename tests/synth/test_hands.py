"""Hands are meshed once a machine."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asdfviz.synth import hands, implicit, nails
from asdfviz.synth.hands import hand_mesh


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "asdfviz" / "hands"


def test_a_hand_is_read_back_as_it_was_meshed(monkeypatch: pytest.MonkeyPatch) -> None:
    made = hand_mesh.__wrapped__(0)
    monkeypatch.setattr(implicit, "mesh_implicit", None)
    read = hand_mesh.__wrapped__(0)
    for name in ("along_arm", "pinch", "entry", "nails"):
        np.testing.assert_array_equal(getattr(made, name), getattr(read, name), strict=True)
    np.testing.assert_array_equal(made.mesh.vertices, read.mesh.vertices, strict=True)
    np.testing.assert_array_equal(made.mesh.faces, read.mesh.faces, strict=True)
    assert made.gap == read.gap > 0


@pytest.mark.parametrize("module", [hands, implicit, nails])
def test_other_code_makes_another_hand(
    module: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = hands._made_of(0)
    assert before != hands._made_of(1)
    other = tmp_path / "other.py"
    other.write_bytes(Path(vars(module)["__file__"]).read_bytes() + b"\n")
    monkeypatch.setattr(module, "__file__", str(other))
    assert hands._made_of(0) != before
