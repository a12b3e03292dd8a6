"""T_a_b @ T_b_c must cancel and be stored as T_a_c: names that nothing checks will be wrong."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parent.parent / "asdfviz"
NAME = re.compile(r"^Ts?_([a-z]+)_([a-z]+)$")
Pair = tuple[str, str]


def frames_of(node: ast.expr) -> Pair | None:
    """Frames (a, b) of an expression that is named T_a_b, inverted or multiplied."""
    if isinstance(node, ast.Name | ast.Attribute):
        match = NAME.match(node.id if isinstance(node, ast.Name) else node.attr)
        # A field's `part` stands for whichever part the object is about: base.T_camera_part.
        if match is None or (isinstance(node, ast.Attribute) and match[2] == "part"):
            return None
        return (match[1], match[2])
    if isinstance(node, ast.Subscript):
        return frames_of(node.value)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name | ast.Attribute):
        name = node.func.id if isinstance(node.func, ast.Name) else node.func.attr
        inner = frames_of(node.args[0]) if name == "inverse" and node.args else None
        return (inner[1], inner[0]) if inner else None
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
        left, right = frames_of(node.left), frames_of(node.right)
        return (left[0], right[1]) if left and right else None
    return None


def problems(source: str) -> Iterator[str]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult):
            left, right = frames_of(node.left), frames_of(node.right)
            if left and right and left[1] != right[0]:
                yield ast.unparse(node)
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target, value = frames_of(node.targets[0]), frames_of(node.value)
            if target and value and target != value:
                yield ast.unparse(node)


@pytest.mark.parametrize("file", sorted(PACKAGE.rglob("*.py")), ids=lambda f: f.name)
def test_transform_names_cancel(file: Path) -> None:
    assert list(problems(file.read_text())) == []


@pytest.mark.parametrize(
    ("source", "count"),
    [
        ("T_a_c = T_a_b @ T_b_c", 0),
        ("T_b_c = inverse(T_a_b) @ T_a_c", 0),
        ("T_a_c = T_a_b @ T_c_b", 2),
        ("T_c_a = T_a_b @ T_b_c", 1),
        ("T_b_a = T_a_b", 1),
    ],
)
def test_wrong_names_are_seen(source: str, count: int) -> None:
    assert len(list(problems(source))) == count
