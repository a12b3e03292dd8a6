"""The wheel carries models, weights and the sample, and runs where the clone is not."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
FRAMES = 1
"""Of the sample that are run: enough to see that all is there."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An environment with the built wheel in it, which sees the packages of this one."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(REPOSITORY)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    environment = folder / "env"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    pip = [sys.executable, "-m", "pip", "--python", environment / "bin" / "python", "install"]
    bare = ["--quiet", "--no-compile", "--no-deps"]
    subprocess.run([*pip, *bare, wheel], check=True, capture_output=True)
    (packages,) = environment.glob("lib/python*/site-packages")
    # A path alone: the .pth file by which the clone is installed here is not read there.
    (packages / "outer.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return environment


def test_the_installed_wheel_runs_asdf_on_the_sample(installed: Path, tmp_path: Path) -> None:
    (sample,) = installed.glob("lib/python*/site-packages/asdfviz/_bundled/models/*/sample")
    pictures = sorted((sample / "rgb").iterdir())
    assert len(pictures) >= 60
    for picture in pictures[FRAMES:]:
        picture.unlink()
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    # In a new place all loops would be compiled anew, which takes longer than one frame without.
    clean["NUMBA_DISABLE_JIT"] = "1"
    command = [installed / "bin" / "asdfviz", "run", "--method", "asdf", "sample", "--out", "run"]
    subprocess.run(command, check=True, cwd=tmp_path, env=clean, capture_output=True)
    saved = json.loads((tmp_path / "run" / "run.json").read_text())
    assert saved["method"] == "asdf"
    assert str(REPOSITORY) not in saved["assembly"]
    lines = (tmp_path / "run" / "predictions.jsonl").read_text().splitlines()
    assert len(lines) == FRAMES
    assert any(json.loads(line)["poses"] for line in lines)


def test_the_wheel_leaves_out_what_runs_leave_beside_models(installed: Path) -> None:
    (models,) = installed.glob("lib/python*/site-packages/asdfviz/_bundled/models")
    assert {"crops.safetensors", "gbot", "vise"} <= {path.name for path in models.iterdir()}
    (wheel,) = installed.parent.glob("*.whl")
    with zipfile.ZipFile(wheel) as packed:
        assert not [name for name in packed.namelist() if "/." in name]
