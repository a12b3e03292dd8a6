"""The page on assembly.yaml: its example loads, is sound, and leaves nothing out."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from asdfviz.data.assembly import FILE_KEYS, PART_KEYS, load_assembly
from asdfviz.data.states_section import JOINT_KINDS, STATE_KEYS
from asdfviz.datatypes import Assembly
from asdfviz.evaluate.health_assembly import check_assembly_alone

PAGE = Path(__file__).resolve().parents[2] / "docs" / "assembly.md"


def block(size: tuple[float, float, float], *, at: tuple[float, float, float]) -> Any:
    return trimesh.creation.box(size).apply_translation(at)


def column(radius: float, height: float, *, bottom: float = 0.0) -> Any:
    shape: Any = trimesh.creation.cylinder(radius, height)
    return shape.apply_translation((0, 0, bottom + height / 2))


SHAPES = {
    "plate": (block((60, 40, 10), at=(0, 0, 0)), block((10, 4, 6), at=(10, 18, 8))),
    "slider": (block((20, 30, 8), at=(0, 0, 4)), block((8, 8, 4), at=(0, 0, 10))),
    "knob": (column(8, 6), column(5, 8, bottom=6)),
    "bolt": (column(2, 6), column(3, 4, bottom=6)),
}


@pytest.fixture
def clip(tmp_path: Path) -> Assembly:
    example = re.search(r"```yaml\n(.*?)```", PAGE.read_text(), re.S)
    assert example is not None
    (tmp_path / "assembly.yaml").write_text(example.group(1))
    for name, shapes in SHAPES.items():
        trimesh.util.concatenate(shapes).export(tmp_path / f"{name}.stl")
    return load_assembly(tmp_path)


def test_the_example_means_what_its_comments_say(clip: Assembly) -> None:
    assert [s.name for s in clip.steps] == ["plate", "slider", "knob", "bolts"]
    across, missing, lost = clip.errors
    assert (across.completed, missing.completed, lost.completed) == (0, 0, 3)
    assert set(missing.attached) == {"plate", "knob"}
    assert set(lost.attached) == {"plate", "slider", "knob", "bolt-1"}
    np.testing.assert_allclose(across.T_base_part["slider"][:3, 0], [0, 1, 0])
    joints = clip.steps[-1].joints
    assert joints["slider"].slide == (0.0, 0.01)
    assert joints["knob"].turn == pytest.approx((-np.pi / 2, np.pi / 2))
    assert [len(p.symmetries.discrete) for p in clip.parts.values()] == [0, 1, 0, 0, 0]
    assert [len(p.symmetries.continuous) for p in clip.parts.values()] == [0, 0, 1, 1, 1]


def test_the_example_is_sound(clip: Assembly) -> None:
    assert check_assembly_alone(clip).findings == ()


def test_the_page_names_every_key() -> None:
    text = PAGE.read_text()
    keys = {*FILE_KEYS, *PART_KEYS, *STATE_KEYS, *JOINT_KINDS, "after", "remove", "link"}
    assert {key for key in keys if not re.search(rf"\b{key}\b", text)} == set()
