from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from asdfviz.errors import InputError
from asdfviz.train import pieces
from asdfviz.train.checkpoint import load_checkpoint
from asdfviz.train.kit import main
from asdfviz.train.pieces import cut_file, join_file

ABSENT = (
    *("viser", "pyrender", "OpenGL", "tyro", "rich", "manifold3d", "small_gicp", "numba"),
    *("scipy", "networkx", "fast_simplification", "PIL"),
)


def line(*more: str, out: Path, work: Path) -> list[str]:
    named = ["--assemblies", "corner_clamp", "--out", str(out), "--work", str(work), *more]
    small = ["--image-size", "128", "--batch", "2", "--fresh", "4", "--loaders", "1"]
    return [*named, *small, "--device", "cpu", "--total", "1000", "--sitting-steps", "2"]


def test_a_run_goes_on_from_what_a_sitting_brought_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    for name in ABSENT:  # for the processes that render, too
        (tmp_path / "absent" / f"{name}.py").parent.mkdir(exist_ok=True)
        (tmp_path / "absent" / f"{name}.py").write_text(f"raise ModuleNotFoundError({name!r})")
    first = subprocess.run(
        [sys.executable, "-m", "asdfviz.train.kit", *line(out=out, work=tmp_path / "here")],
        env={**os.environ, "PYTHONPATH": str(tmp_path / "absent")},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert first.returncode == 130, first.stderr
    assert "inputs/s" in first.stdout
    names = {p.name for p in out.iterdir()}
    assert names >= {"weights.safetensors", "weights.json", "state.pt.000", "state.pt.json"}
    assert len(names) <= 8
    carried = ("--carried", str(out))
    assert main(line(*carried, out=tmp_path / "more", work=tmp_path / "there")) == 130
    steps = [load_checkpoint(tmp_path / f / "last.pt")["progress"][0] for f in ("here", "there")]
    assert steps == [2, 4]
    lost = ("--carried", str(tmp_path))
    assert main(line(*lost, out=tmp_path / "no", work=tmp_path / "nowhere")) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert "state.pt.json" in told


def test_pieces_join_to_the_same_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "PIECE_BYTES", 1000)
    whole = tmp_path / "whole.bin"
    whole.write_bytes(bytes(range(256)) * 10)
    cut = cut_file(whole, tmp_path)
    assert [p.stat().st_size for p in cut] == [1000, 1000, 560]
    join_file("whole.bin", tmp_path, tmp_path / "again.bin")
    assert (tmp_path / "again.bin").read_bytes() == whole.read_bytes()
    cut[0].write_bytes(b"other")
    with pytest.raises(InputError, match="do not belong together"):
        join_file("whole.bin", tmp_path, tmp_path / "again.bin")
    cut[1].unlink()
    with pytest.raises(InputError, match=r"lacks whole\.bin\.001"):
        join_file("whole.bin", tmp_path, tmp_path / "again.bin")
