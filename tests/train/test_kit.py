from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from asdfviz.errors import InputError
from asdfviz.train import pieces
from asdfviz.train.checkpoint import load_checkpoint
from asdfviz.train.crop_config import CropTrainConfig
from asdfviz.train.kit import main
from asdfviz.train.pieces import cut_file, join_file
from asdfviz.train.state_config import StateTrainConfig

ABSENT = (
    *("viser", "pyrender", "OpenGL", "tyro", "rich", "manifold3d", "small_gicp", "numba"),
    *("scipy", "networkx", "fast_simplification", "PIL"),
)


def line(*more: str, out: Path, work: Path) -> list[str]:
    named = ["--assemblies", "corner_clamp", "--out", str(out), "--work", str(work), *more]
    small = ["--image-size", "128", "--batch", "2", "--fresh", "4", "--loaders", "1"]
    return [*named, *small, "--device", "cpu", "--total", "1000"]


def test_a_run_goes_on_from_what_a_sitting_that_was_ended_early_brought_back(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    for name in ABSENT:  # for the processes that render, too
        (tmp_path / "absent" / f"{name}.py").parent.mkdir(exist_ok=True)
        (tmp_path / "absent" / f"{name}.py").write_text(f"raise ModuleNotFoundError({name!r})")
    first = subprocess.Popen(
        [sys.executable, "-m", "asdfviz.train.kit", *line(out=out, work=tmp_path / "here")],
        env={**os.environ, "PYTHONPATH": str(tmp_path / "absent")},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert first.stdout is not None
    told = first.stdout.readline()
    first.terminate()
    wrong = first.communicate(timeout=300)[1]
    assert first.returncode == 130, wrong
    assert "Traceback" not in wrong
    assert "inputs/s" in told
    names = {p.name for p in out.iterdir()}
    state = {"state.pt.000", "state.pt.json"}
    assert names >= {"weights.safetensors", "weights.json", "log.csv", *state}
    assert len(names) <= 8
    carried = ("--sitting-steps", "2", "--carried", str(out))
    assert main(line(*carried, out=tmp_path / "more", work=tmp_path / "there")) == 130
    begun, more = (
        load_checkpoint(tmp_path / f / "last.pt")["progress"][0] for f in ("here", "there")
    )
    assert 1 <= begun < 100
    assert more == begun + 2
    lost = ("--carried", str(tmp_path))
    assert main(line(*lost, out=tmp_path / "no", work=tmp_path / "nowhere")) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert "state.pt.json" in told


@pytest.mark.parametrize(
    ("network", "session"), [("crops", "CropSession"), ("states", "StateSession")]
)
def test_crops_are_not_judged_first_where_a_sitting_is_ended_early(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, network: str, session: str
) -> None:
    done: list[str] = []

    class Session:
        last = tmp_path / "work" / "last.pt"

        def __init__(self, config: CropTrainConfig | StateTrainConfig) -> None:
            (config.output / "log.csv").write_text("")

        def go(self, report: object, stop: Callable[[], bool]) -> bool:
            assert not stop()
            signal.raise_signal(signal.SIGTERM)
            assert stop()
            self.checkpoint()
            return False

        def validate(self) -> None:
            done.append("judged")

        def checkpoint(self) -> None:
            self.last.write_text("all of it")

    monkeypatch.setattr(f"asdfviz.train.kit.{session}", Session)
    assert main(line("--network", network, out=tmp_path / "out", work=tmp_path / "work")) == 130
    assert not done
    assert (tmp_path / "out" / "state.pt.000").read_text() == "all of it"


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
