"""The command line: help with examples, exit codes, and the README's own commands."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from asdfviz.cli import main

README = Path(__file__).resolve().parents[2] / "README.md"
COMMANDS = (
    "view",
    "run",
    "evaluate",
    "check",
    "methods",
    "synth",
    "train",
    "import-gbot",
    "export",
    "bench",
)
FIRST_OF = {"synth": "images", "bench": "track"}
"""Commands with a level below them."""


def exit_code(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert isinstance(caught.value.code, int)
    return caught.value.code


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code(command, "--help") == 0
    shown = capsys.readouterr().out
    if command in FIRST_OF:
        assert exit_code(command, FIRST_OF[command], "--help") == 0
        shown = capsys.readouterr().out
    assert f"Example: asdfviz {command}" in shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("check", "no/such/folder"), "no/such/folder"),
        (("run", "no/such/folder", "--method", "asdf"), "no/such/folder"),
        (("run", "sample", "--method", "nonsense"), "nonsense"),
        (("run", "sample", "--method", "asdf", "--assembly", "nowhere"), "nowhere"),
        (("evaluate", "no/such/run"), "no/such/run"),
        (("evaluate",), "run"),
        (("import-gbot", "no/such/folder", "--out", "x"), "no/such/folder"),
        (("methods", "--surprise"), "--surprise"),
    ],
)
def test_bad_input_exits_2_with_one_line(
    arguments: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code(*arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error


def test_methods_lists_the_paper_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert exit_code("methods", "--json") == 0
    names = {row["name"] for row in json.loads(capsys.readouterr().out)}
    assert {"yolov8pose", "asdf"} <= names


def test_every_command_of_the_readme_parses() -> None:
    lines = re.findall(r"^    (asdfviz [^#\n]+)", README.read_text(), flags=re.MULTILINE)
    assert len(lines) >= 8
    for line in lines:
        command = shlex.split(line)[1]
        assert command in COMMANDS, line
