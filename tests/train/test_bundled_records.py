from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

LOADED = """
import ast, sys
from pathlib import Path
import asdfviz.train.kit
names = {"cv2": "opencv", "yaml": "pyyaml"}
ours = [m.__file__ for n, m in sys.modules.items() if n.split(".")[0] == "asdfviz"]
for file in filter(None, ours):
    for node in ast.parse(Path(file).read_text()).body:
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            named = [node.module] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
            for name in {str(n).split(".")[0] for n in named} - sys.stdlib_module_names - {"asdfviz"}:
                print(names.get(name, name))
"""
"""Prints what the kit's own modules import beside the standard library."""
MODELS = Path(__file__).resolve().parents[2] / "models"


@pytest.mark.parametrize(
    "file", sorted(MODELS.rglob("weights.json")), ids=lambda f: str(f.relative_to(MODELS))
)
def test_a_command_that_is_spelt_otherwise_today_says_how(file: Path) -> None:
    record = json.loads(file.read_text(encoding="utf-8"))
    lines = record["command"] if isinstance(record["command"], list) else [record["command"]]
    for line in lines:
        if "synth images" in line and "--packs" in line:
            options = line.split("synth images", 1)[1].replace(" --packs", "")
            assert f"asdfviz synth packs{options}" in record["command_today"]


def test_the_readme_names_the_packages_that_the_gpu_kit_needs() -> None:
    readme = (MODELS.parent / "README.md").read_text(encoding="utf-8")
    section = readme.split("### Developer section", 1)[1].split("\n## ", 1)[0]
    assert "asdfviz.train.kit" in section
    found = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True)
    assert found.returncode == 0, found.stderr
    loaded = set(found.stdout.split())
    assert loaded >= {"torch", "numpy", "opencv"}
    assert {name for name in loaded if name not in section} == set()
