"""An assembly by itself: blocks on a plate whose places and shapes are known."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from asdfviz.data.assembly import load_assembly
from asdfviz.data.meshes import default_keypoints
from asdfviz.data.resources import bundled_assemblies
from asdfviz.datatypes import Assembly, Joint, Mesh, Part, State
from asdfviz.evaluate.health_assembly import check_assembly_alone
from asdfviz.evaluate.health_report import Kind
from asdfviz.evaluate.health_symmetry import declared, own_turns
from asdfviz.evaluate.pose_errors import nearest_points
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import apply, rotation_about, transform_from, turn_about
from asdfviz.synth.primitives import box

Z = np.array([0.0, 0.0, 1.0])
HALF_TURN = Symmetries(discrete=(turn_about(Z, np.zeros(3), np.pi),))


def part(name: str, mesh: Mesh, symmetries: Symmetries | None = None) -> Part:
    return Part(
        name=name,
        mesh=mesh,
        keypoints=default_keypoints(mesh),
        symmetries=symmetries or Symmetries(continuous=(Axis(Z, np.zeros(3)),)),
        diameter=diameter(mesh.vertices),
        color=np.zeros(3, np.uint8),
        detector_class=name.removesuffix("-Copy"),
    )


def at(x: float, y: float = 0.0, z: float = 0.0, turn: float = 0.0) -> np.ndarray:
    return transform_from(rotation_about(Z, turn), np.array([x, y, z]) / 1e3)


def assembly(**poses: dict[str, np.ndarray]) -> Assembly:
    """A plate of 80 x 60 x 10 mm and three blocks of 20 x 20 x 20 mm; joined as the states say."""
    block = box((0.02, 0.02, 0.02))
    parts = {"plate": part("plate", box((0.08, 0.06, 0.01)))}
    parts |= {name: part(name, block) for name in ("block", "block-Copy")}
    parts["lid"] = part("lid", box((0.03, 0.02, 0.02)), HALF_TURN)
    states = [
        State(index=i, name=name, T_base_part={"plate": np.eye(4), **joined})
        for i, (name, joined) in enumerate({"plate": {}, **poses}.items())
    ]
    return Assembly(
        name="blocks",
        title="Blocks",
        base="plate",
        parts=parts,
        states=tuple(states),
        transitions=frozenset(),
        detector_classes=tuple(parts),
        path="blocks/assembly.yaml",
    )


def said(one: Assembly, kind: Kind) -> list[str]:
    return [f.message for f in check_assembly_alone(one).findings if f.kind == kind]


ON = at(0, z=15)
"""A block on the plate."""


def test_what_fits_is_clean_and_progress_is_told() -> None:
    told: list[tuple[int, int, str]] = []
    good = assembly(block={"block": ON}, lid={"block": ON, "lid": at(0, z=35)})
    report = check_assembly_alone(good, progress=lambda *now: told.append(now))
    assert report.findings == ()
    assert (report.parts, report.states) == (4, 3)
    assert told[1] == (1, 5, "state block")
    assert told[-1] == (5, 5, "")


@pytest.mark.parametrize("name", sorted(bundled_assemblies()))
def test_our_own_assemblies_are_clean(name: str) -> None:
    report = check_assembly_alone(load_assembly(name))
    assert report.findings == ()
    assert json.loads(json.dumps(report.to_json()))["assembly"] == name


def test_parts_that_stand_in_each_other_are_named_once() -> None:
    deep = {"block": at(0, z=15 - 4), "lid": at(30, z=15 - 0.8)}
    (message,) = said(assembly(one=deep, two={**deep, "block-Copy": at(-25, z=15)}), "overlap")
    assert message.startswith("plate and block stand 4.0 mm deep in each other in one, two.")


def test_parts_that_touch_nothing_are_named_with_what_hangs_on_them() -> None:
    assert not said(assembly(near={"block": at(0, z=15 + 4)}), "floating")
    away = assembly(one={"block": at(0, z=15 + 12)}, two={"block": at(0, z=27), "lid": at(0, z=47)})
    alone, both = said(away, "floating")
    assert alone.startswith("block is 12.0 mm away from every other part in one.")
    assert both.startswith("block and lid are 12.0 mm away from every other part in two.")


def test_states_that_nothing_tells_apart_are_named() -> None:
    one = {"block": ON, "lid": at(30, z=15)}
    same = {"block-Copy": at(0.5, z=15, turn=1.0), "lid": at(30, z=15, turn=np.pi)}
    (message,) = said(assembly(one=one, same=same, other={"block": ON}), "same_states")
    assert message.startswith("one and same put the same parts in the same places")
    crossed = {**one, "lid": at(30, z=15, turn=np.pi / 2)}
    assert not said(assembly(one=one, crossed=crossed), "same_states")


@pytest.mark.parametrize(
    ("symmetries", "turned", "elsewhere"),
    [
        (Symmetries(continuous=(Axis(Z, np.zeros(3)),)), at(0, 30, 15), at(0, 20, 15)),
        (HALF_TURN, at(-30, 0, 15), at(0, 30, 15)),
    ],
)
def test_a_turn_of_a_base_that_looks_the_same_tells_no_states_apart(
    symmetries: Symmetries, turned: np.ndarray, elsewhere: np.ndarray
) -> None:
    ways = assembly(
        one={"block": at(30, z=15)}, turned={"block": turned}, elsewhere={"block": elsewhere}
    )
    plates = [replace(ways.parts["plate"], symmetries=s) for s in (symmetries, Symmetries())]
    same, none = (replace(ways, parts={**ways.parts, "plate": plate}) for plate in plates)
    (message,) = said(same, "same_states")
    assert message.startswith("one and turned put the same parts in the same places")
    assert not said(none, "same_states")


def test_what_a_joint_allows_tells_no_states_apart() -> None:
    two = assembly(one={"block": ON}, moved={"block": at(8, z=15)})
    assert not said(two, "same_states")
    slide = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), slide=(-0.01, 0.01))
    slid = replace(two.states[1], joints={"block": slide})
    assert said(replace(two, states=(two.states[0], slid, two.states[2])), "same_states")


@pytest.mark.parametrize(
    ("scale", "words"), [(0.1, None), (0.05, "cm, m or inches"), (10, "in mm, set 'unit'")]
)
def test_sizes_of_another_unit_are_told(scale: float, words: str | None) -> None:
    one = assembly()
    parts = {
        name: part(name, Mesh(p.mesh.vertices * scale, p.mesh.faces), p.symmetries)
        for name, p in one.parts.items()
    }
    messages = said(replace(one, parts=parts), "mesh_unit")
    if words is None:
        assert not messages
    else:
        (message,) = messages
        assert words in message


def cylinder(sides: int, *, bump: bool = False) -> Mesh:
    """Of 20 mm diameter and 50 mm height."""
    shape: Any = trimesh.creation.cylinder(0.01, 0.05, sections=sides)
    if bump:
        shape = trimesh.util.concatenate(
            shape, trimesh.creation.box((0.02, 0.01, 0.04)).apply_translation((0.012, 0, 0))
        )
    return Mesh(np.asarray(shape.vertices, np.float64), np.asarray(shape.faces, np.int32))


@pytest.mark.parametrize(
    ("mesh", "folds"),
    [
        (cylinder(64), {"z": 0, "x": 2, "y": 2}),
        (cylinder(3), {"z": 3, "x": 2}),
        (cylinder(64, bump=True), {"x": 2}),
        (box((0.02, 0.03, 0.05)), {"x": 2, "y": 2, "z": 2}),
        (box((0.03, 0.03, 0.05)), {"x": 2, "y": 2, "z": 4}),
    ],
)
@pytest.mark.parametrize("is_turned", [False, True])
def test_turns_of_a_part_onto_itself_are_found(
    mesh: Mesh, folds: dict[str, int], is_turned: bool
) -> None:
    R = rotation_about(np.array([0.3, 1.0, 0.2]), 0.6) if is_turned else np.eye(3)
    moved = Mesh(apply(transform_from(R, np.array([0.02, 0.01, 0.4])), mesh.vertices), mesh.faces)
    turns = own_turns(part("one", moved, Symmetries()))
    named = {"xyz"[int(np.abs(R.T @ turn.axis).argmax())]: turn.folds for turn in turns}
    if is_turned:  # of like sides any two axes at right angles do as main ones
        assert named.get("z") == folds.get("z")
    else:
        assert named == folds


@pytest.mark.parametrize(
    ("mesh", "discrete", "continuous"),
    [
        (box((0.02, 0.03, 0.05)), 3, 0),
        (box((0.03, 0.03, 0.05)), 7, 0),
        (cylinder(64), 1, 1),
        (cylinder(64, bump=True), 1, 0),
    ],
)
def test_what_to_declare_is_told_as_the_file_takes_it(
    mesh: Mesh, discrete: int, continuous: int, tmp_path: Path
) -> None:
    moved = Mesh(mesh.vertices + np.array([0.02, 0.01, 0.4]), mesh.faces)
    trimesh.Trimesh(1e3 * moved.vertices, moved.faces).export(tmp_path / "one.ply")
    said = declared(moved, own_turns(part("one", moved, Symmetries())))
    about = (
        f"{{name: a, unit: mm, base: one, parts: {{one: {{mesh: one.ply, symmetries: {said}}}}}, "
    )
    (tmp_path / "assembly.yaml").write_text(f"{about}states: [{{name: one}}]}}")
    found = load_assembly(str(tmp_path)).parts["one"].symmetries
    assert (len(found.discrete), len(found.continuous)) == (discrete, continuous)
    places = nearest_points(moved.vertices)
    for S in found.transforms(step=0.7):
        corners = apply(S, moved.vertices)
        assert continuous or places.query(corners)[0].max() < 5e-4


def test_symmetries_that_are_not_declared_are_told_once_for_copies() -> None:
    one = assembly()
    plain = {
        name: replace(p, symmetries=Symmetries()) if name.startswith("block") else p
        for name, p in one.parts.items()
    }
    (message,) = said(replace(one, parts=plain), "symmetry")
    assert message.startswith("block and block-Copy look the same turned by 90 degrees about")
    assert "through (0.0, 0.0, 0.0) mm, but" in message
