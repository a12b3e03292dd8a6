"""One clear error for every way in which an assembly.yaml can be wrong."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml

from asdfviz.data.assembly import find_assembly, load_assembly
from asdfviz.data.ply import ply_bytes
from asdfviz.data.resources import bundled_assemblies
from asdfviz.datatypes import Mesh
from asdfviz.errors import AssemblyError

GOOD: dict[str, Any] = {
    "name": "toy",
    "title": "A toy",
    "unit": "mm",
    "base": "plate",
    "parts": {
        "plate": {"mesh": "plate.ply", "color": [0, 90, 170]},
        "pin": {
            "mesh": "pin.ply",
            "symmetries": {
                "discrete": [[-1, 0, 0, 4, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]],
                "continuous": [{"axis": [0, 0, 2], "offset": [1, 0, 0]}],
            },
        },
        "pin-Copy": {"mesh": "pin.ply", "detector_class": "pin", "obj_id": 9},
    },
    "states": [
        {"name": "plate"},
        {
            "name": "pinned",
            "poses": {"pin": {"t": [10, 20, 30]}},
            "joints": {"pin": {"kind": "cylindrical", "slide": [-5, 5], "turn": [-90, 90]}},
        },
        {"name": "both", "poses": {"pin-Copy": {"R": [0, -1, 0, 1, 0, 0, 0, 0, 1]}}},
    ],
    "errors": [
        {"name": "wrong_hole", "after": "plate", "poses": {"pin": {"t": [-10, 20, 30]}}},
        {"name": "pin_lost", "after": "both", "remove": ["pin"]},
    ],
}


def tetrahedron(size: float) -> Mesh:
    vertices = np.array([[0, 0, 0], [size, 0, 0], [0, size, 0], [0, 0, size]])
    faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    return Mesh(vertices, np.array(faces, dtype=np.int32))


@pytest.fixture
def write(tmp_path: Path) -> Callable[[dict[str, Any]], Path]:
    """Writes an assembly folder and returns its yaml."""

    def write_yaml(content: dict[str, Any]) -> Path:
        (tmp_path / "plate.ply").write_bytes(ply_bytes(tetrahedron(0.08)))
        (tmp_path / "pin.ply").write_bytes(ply_bytes(tetrahedron(0.03)))
        file = tmp_path / "assembly.yaml"
        file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
        return file

    return write_yaml


def test_everything_is_read(write: Callable[[dict[str, Any]], Path]) -> None:
    toy = load_assembly(write(GOOD))
    assert (toy.name, toy.title, toy.base) == ("toy", "A toy", "plate")
    assert list(toy.parts) == ["plate", "pin", "pin-Copy"]
    assert toy.detector_classes == (
        "plate", "pin", "toy:pinned", "toy:both", "toy:wrong_hole", "toy:pin_lost"
    )  # fmt: skip
    assert [s.name for s in toy.steps] == ["plate", "pinned", "both"]
    assert [s.completed for s in toy.states] == [0, 1, 2, 0, 2]
    assert toy.states[0].detector_class is None
    assert toy.transitions == {(0, 1), (1, 2), (0, 3), (3, 0), (2, 4), (4, 2)}
    assert toy.parts["pin-Copy"].obj_id == 9
    assert toy.parts["plate"].color.tolist() == [0, 90, 170]
    assert len(np.unique(toy.parts["plate"].keypoints, axis=0)) == 17
    assert toy.parts["plate"].diameter == pytest.approx(0.08 * 2**0.5, rel=1e-3)


def test_lengths_become_metres_and_angles_radians(
    write: Callable[[dict[str, Any]], Path],
) -> None:
    toy = load_assembly(write(GOOD))
    np.testing.assert_allclose(toy.parts["plate"].mesh.vertices.max(axis=0), 0.08, rtol=1e-6)
    np.testing.assert_allclose(toy.states[1].T_base_part["pin"][:3, 3], [0.01, 0.02, 0.03])
    joint = toy.states[1].joints["pin"]
    assert joint.slide == pytest.approx((-0.005, 0.005))
    assert joint.turn == pytest.approx((-np.pi / 2, np.pi / 2))
    axis = toy.parts["pin"].symmetries.continuous[0]
    np.testing.assert_allclose(axis.direction, [0, 0, 1])
    np.testing.assert_allclose(axis.offset, [0.001, 0, 0])
    np.testing.assert_allclose(toy.parts["pin"].symmetries.discrete[0][:3, 3], [0.004, 0, 0])


def test_what_was_joined_stays_joined(write: Callable[[dict[str, Any]], Path]) -> None:
    toy = load_assembly(write(GOOD))
    assert toy.states[0].attached == ("plate",)
    assert set(toy.states[2].attached) == {"plate", "pin", "pin-Copy"}
    assert "pin" in toy.states[2].joints
    np.testing.assert_array_equal(
        toy.states[2].T_base_part["pin"], toy.states[1].T_base_part["pin"]
    )
    lost = toy.states[4]
    assert set(lost.attached) == {"plate", "pin-Copy"}
    assert lost.joints == {}
    assert lost.is_error


def test_a_unit_of_its_own_for_one_mesh(write: Callable[[dict[str, Any]], Path]) -> None:
    content = copy.deepcopy(GOOD)
    content["parts"]["plate"]["unit"] = "cm"
    toy = load_assembly(write(content))
    assert toy.parts["plate"].diameter == pytest.approx(0.8 * 2**0.5, rel=1e-3)
    np.testing.assert_allclose(toy.states[1].T_base_part["pin"][:3, 3], [0.01, 0.02, 0.03])


def test_own_transitions_replace_the_usual_ones(write: Callable[[dict[str, Any]], Path]) -> None:
    content = copy.deepcopy(GOOD)
    content["transitions"] = [["plate", "both"], ["both", "plate"]]
    assert load_assembly(write(content)).transitions == {(0, 2), (2, 0)}


def test_keypoints_from_a_file(write: Callable[[dict[str, Any]], Path]) -> None:
    content = copy.deepcopy(GOOD)
    content["parts"]["pin"]["keypoints"] = "pin.txt"
    file = write(content)
    rows = np.random.default_rng(1).random((17, 3)) * 0.05
    np.savetxt(file.parent / "pin.txt", rows)
    np.testing.assert_allclose(load_assembly(file).parts["pin"].keypoints, rows)


def test_every_bundled_assembly_loads() -> None:
    assert "corner_clamp" in bundled_assemblies()
    for name in bundled_assemblies():
        assert load_assembly(name).name == name


@pytest.mark.parametrize("missing", ["no_such_assembly", "/no/such/folder"])
def test_an_unknown_assembly_names_the_bundled_ones(missing: str) -> None:
    with pytest.raises(AssemblyError, match="corner_clamp"):
        find_assembly(missing)


def change(*path: str | int, to: object = None, drop: bool = False) -> Callable[[Any], None]:
    """Changes or drops one entry of the good assembly."""

    def apply(content: Any) -> None:
        for key in path[:-1]:
            content = content[key]
        if drop:
            del content[path[-1]]
        else:
            content[path[-1]] = to

    return apply


TURNED_OVER = [1, 0, 0, 0, 1, 0, 0, 0, -1]
BROKEN = [
    pytest.param(change("unit", drop=True), "'unit' is missing", id="no unit"),
    pytest.param(change("unit", to="inch"), "'inch', use mm or cm or m", id="unknown unit"),
    pytest.param(change("name", drop=True), "'name' is missing", id="no name"),
    pytest.param(change("name", to=["a"]), "'name' must be text", id="name is a list"),
    pytest.param(change("base", to="lid"), "base 'lid' is not a part; parts: plate", id="base"),
    pytest.param(change("parts", to={}), "'parts' is empty", id="no parts"),
    pytest.param(change("parts", to=[1]), "'parts' must be a mapping", id="parts is a list"),
    pytest.param(change("parts", "pin", to=3), "part 'pin': expected a mapping", id="part"),
    pytest.param(change("parts", "pin", "mesh", drop=True), "'mesh' is missing", id="no mesh"),
    pytest.param(
        change("parts", "pin", "mesh", to="nut.ply"), "nut.ply does not exist", id="mesh file"
    ),
    pytest.param(change("parts", "pin", "mesh", to="."), "is a folder", id="mesh folder"),
    pytest.param(
        change("parts", "pin", "unit", to="m"),
        "its own 'unit' says m: should it be mm",
        id="mesh in m",
    ),
    pytest.param(change("parts", "pin", "color", to=[1, 2]), "'color' must be 3", id="color"),
    pytest.param(
        change("parts", "pin", "color", to=[0, 300, 0]), "from 0 to 255", id="color range"
    ),
    pytest.param(
        change("titel", to="A toy"), "unknown key 'titel'; did you mean 'title'", id="slip"
    ),
    pytest.param(change("lens", to=1), "unknown key 'lens'; known: name, title", id="key"),
    pytest.param(
        change("parts", "pin", "symmetry", to={}), "did you mean 'symmetries'", id="part key"
    ),
    pytest.param(
        change("parts", "pin", "symmetries", "axes", to=[]), "unknown key 'axes'", id="axes"
    ),
    pytest.param(change("states", 1, "pose", to={}), "did you mean 'poses'", id="state key"),
    pytest.param(
        change("states", 1, "poses", "pin", "T", to=[]), "unknown key 'T'; known: R, t", id="T"
    ),
    pytest.param(
        change("states", 1, "joints", "pin", "slides", to=[]), "did you mean 'slide'", id="joint"
    ),
    pytest.param(
        change("states", 1, "after", to="plate"), "state 1: unknown key 'after'", id="after a state"
    ),
    pytest.param(
        change("states", 1, "joints", "pin", "slide", to=[5, -5]),
        "'slide' goes from 5 to -5; give the lower end first",
        id="slide turned round",
    ),
    pytest.param(change("parts", "pin", "obj_id", to="7"), "whole number, got '7'", id="obj_id"),
    pytest.param(change("parts", "pin", "keypoints", to="k.txt"), "cannot be read", id="keypoints"),
    pytest.param(
        change("parts", "pin", "symmetries", "discrete", to=[[1, 2, 3]]),
        "must be 16 finite numbers",
        id="symmetry row",
    ),
    pytest.param(
        change("parts", "pin", "symmetries", "continuous", 0, "axis", to=[0, 0, 0]),
        "an axis has length 0",
        id="symmetry axis",
    ),
    pytest.param(change("states", to=[]), "'states' is empty", id="no states"),
    pytest.param(change("states", to={"a": 1}), "'states' must be a list", id="states"),
    pytest.param(change("states", 1, "name", drop=True), "state 1: 'name'", id="state name"),
    pytest.param(
        change("states", 1, "poses", to={"nut": {}}), "state 1: poses: 'nut' is not", id="pose of"
    ),
    pytest.param(
        change("states", 1, "poses", "pin", "t", to=[1, float("nan"), 3]),
        "3 finite numbers",
        id="NaN",
    ),
    pytest.param(
        change("states", 1, "poses", "pin", "t", to=["a", 1, 2]), "must be 3 numbers", id="text"
    ),
    pytest.param(
        change("states", 1, "poses", "pin", "R", to=TURNED_OVER),
        "pose of 'pin': not a rotation",
        id="a mirror",
    ),
    pytest.param(
        change("states", 1, "joints", to={"pin-Copy": {"kind": "ball"}}),
        "'pin-Copy' is not known here; known: plate, pin",
        id="joint of a loose part",
    ),
    pytest.param(
        change("states", 1, "joints", "pin", "kind", to="hinge"),
        "'hinge', use prismatic",
        id="kind",
    ),
    pytest.param(
        change("states", 1, "joints", "pin", "axis", to=[0, 0, 0]), "axis has length 0", id="axis"
    ),
    pytest.param(change("errors", 0, "name", to="pinned"), "two states have one name", id="twice"),
    pytest.param(
        change("states", 2, "detector_class", to="plate"), "two detector classes", id="class twice"
    ),
    pytest.param(
        change("errors", 0, "after", to="lid"), "'after' is 'lid', use a state", id="after"
    ),
    pytest.param(
        change("errors", 0, "after", drop=True), "error 0: 'after' is missing", id="no after"
    ),
    pytest.param(
        change("errors", 1, "remove", to=["plate"]), "cannot remove plate", id="base removed"
    ),
    pytest.param(change("errors", 1, "remove", to=["nut"]), "cannot remove nut", id="remove"),
    pytest.param(
        change("transitions", to=[["plate", "end"]]), "transitions: 'end' is not known", id="to"
    ),
    pytest.param(
        change("transitions", to=[["plate"]]), "a transition is \\[from, to\\]", id="half"
    ),
]


def test_a_mesh_in_metres_among_millimetres_needs_a_unit_of_its_own(
    write: Callable[[dict[str, Any]], Path],
) -> None:
    content = copy.deepcopy(GOOD)
    content["parts"]["knob"] = {"mesh": "knob.glb"}
    file = write(content)
    small = tetrahedron(0.03)
    exported: Any = trimesh.Trimesh(small.vertices, small.faces)
    exported.export(file.with_name("knob.glb"))
    with pytest.raises(
        AssemblyError, match=r"part 'knob'.*the assembly's 'unit' says mm"
    ) as caught:
        load_assembly(file)
    assert "give the part a unit of its own, {mesh: knob.glb, unit: m}" in str(caught.value)
    content["parts"]["knob"]["unit"] = "m"
    assert load_assembly(write(content)).parts["knob"].diameter == pytest.approx(0.03 * 2**0.5)


@pytest.mark.parametrize(("damage", "message"), BROKEN)
def test_one_clear_error(
    write: Callable[[dict[str, Any]], Path], damage: Callable[[Any], None], message: str
) -> None:
    content = copy.deepcopy(GOOD)
    damage(content)
    file = write(content)
    with pytest.raises(AssemblyError, match=message) as caught:
        load_assembly(file)
    assert "\n" not in str(caught.value)
    # It says where: the file, or for a mesh the part.
    assert str(file) in str(caught.value) or "part '" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("", "not a YAML mapping", id="empty"),
        pytest.param("- a\n- b\n", "not a YAML mapping", id="a list"),
        pytest.param("a: [1, 2", "cannot be read", id="no YAML"),
        pytest.param("!!python/object:os.system {}", "cannot be read", id="a tag that runs code"),
    ],
)
def test_a_file_that_is_no_assembly(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "assembly.yaml").write_text(text)
    with pytest.raises(AssemblyError, match=message) as caught:
        load_assembly(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        pytest.param(b"", "cannot be read|no triangles", id="empty"),
        pytest.param(
            b"ply\nformat ascii 1.0\nend_header\n", "cannot be read|no triangles", id="bare"
        ),
        pytest.param(
            ply_bytes(Mesh(np.full((3, 3), np.nan), np.array([[0, 1, 2]], dtype=np.int32))),
            "not finite",
            id="NaN",
        ),
    ],
)
def test_a_broken_mesh(write: Callable[[dict[str, Any]], Path], data: bytes, message: str) -> None:
    file = write(GOOD)
    (file.parent / "pin.ply").write_bytes(data)
    with pytest.raises(AssemblyError, match=message):
        load_assembly(file)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        pytest.param("1 2 3\n", "shape", id="one row"),
        pytest.param("0.1 0.2\n" * 17, "shape", id="two columns"),
        pytest.param("10 20 30\n" * 17, "in metres, not millimetres", id="mm"),
        pytest.param("a b c\n" * 17, "cannot be read", id="text"),
    ],
)
def test_broken_keypoints(write: Callable[[dict[str, Any]], Path], rows: str, message: str) -> None:
    content = copy.deepcopy(GOOD)
    content["parts"]["pin"]["keypoints"] = "pin.txt"
    file = write(content)
    (file.parent / "pin.txt").write_text(rows)
    with pytest.raises(AssemblyError, match=message):
        load_assembly(file)


def test_a_key_that_is_there_twice_is_refused(write: Callable[[dict[str, Any]], Path]) -> None:
    file = write(GOOD)
    text = file.read_text()
    file.write_text(text.replace("  pin-Copy:", "  pin:", 1))
    with pytest.raises(AssemblyError, match="'pin' is there twice"):
        load_assembly(file)
    file.write_text(text)
    assert len(load_assembly(file).parts) == 3


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (
            [[0, 0, 0], [9, 0, 0], [0, 9, 0]],
            [[0, 1, 3]],
            "a triangle with corner 3, of corners 0 to 2",
        ),
        ([[0, 0, 0], [9, 0, 0], [0, 9, 0]], [[0, 1, -1]], "a triangle with corner -1"),
        ([[0, 0, 0], [9, 0, 0], [18, 0, 0]], [[0, 1, 2]], "has no area"),
    ],
)
def test_a_mesh_of_broken_triangles_is_refused(
    write: Callable[[dict[str, Any]], Path], vertices: list[Any], faces: list[Any], said: str
) -> None:
    file = write(GOOD)
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    header += (
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = [*vertices, [3, *faces[0]]]
    (file.parent / "pin.ply").write_text(
        header + "\n".join(" ".join(map(str, r)) for r in rows) + "\n"
    )
    with pytest.raises(AssemblyError, match=said):
        load_assembly(file)


def test_a_number_beyond_all_bounds_is_refused(write: Callable[[dict[str, Any]], Path]) -> None:
    content = copy.deepcopy(GOOD)
    content["states"][1]["poses"]["pin"]["t"] = [10**400, 0, 0]
    with pytest.raises(AssemblyError, match="must be 3 numbers"):
        load_assembly(write(content))


def test_two_parts_of_one_number_are_refused(write: Callable[[dict[str, Any]], Path]) -> None:
    content = copy.deepcopy(GOOD)
    content["parts"]["plate"]["obj_id"] = content["parts"]["pin"]["obj_id"] = 7
    with pytest.raises(AssemblyError, match="'plate' and 'pin' both have obj_id 7"):
        load_assembly(write(content))
    # Copies of one mesh cannot be told apart anyway.
    content["parts"]["pin"]["mesh"] = content["parts"]["plate"]["mesh"]
    content["parts"]["pin"].pop("unit", None)
    assert {p.obj_id for p in load_assembly(write(content)).parts.values()} >= {7}


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (
            ("states", 1, "poses", "plate"),
            {"t": [1, 0, 0]},
            "told from the base part; leave it out",
        ),
        (("states", 1, "poses", "pin"), {"t": [9000, 0, 0]}, "9 m from the base part"),
        (("errors", 0, "remove"), ["pin"], "cannot remove pin; joined in 'plate': nothing"),
        (("parts", "plate", "color"), [0.2, 0.5, 1.0], "whole numbers from 0 to 255"),
    ],
)
def test_what_no_assembly_means_is_refused(
    write: Callable[[dict[str, Any]], Path], place: tuple[Any, ...], value: Any, said: str
) -> None:
    content = copy.deepcopy(GOOD)
    target: Any = content
    for step in place[:-1]:
        target = target[step]
    target[place[-1]] = value
    with pytest.raises(AssemblyError, match=said):
        load_assembly(write(content))


@pytest.mark.parametrize(
    "name", ["../evil", "..", "a/b", "a\\b", ".git", "", "  ", "a\0b", "a\nb", "Größe" * 40]
)
def test_a_name_that_leads_to_other_folders_is_refused(
    name: str, write: Callable[[dict[str, Any]], Path]
) -> None:
    with pytest.raises(AssemblyError, match=r"name is .*no slash in it and no dot at its start"):
        load_assembly(write({**copy.deepcopy(GOOD), "name": name}))


def test_a_file_that_is_nested_too_deeply_is_refused(tmp_path: Path) -> None:
    (tmp_path / "assembly.yaml").write_text(f"parts: {'[' * 600}{']' * 600}")
    with pytest.raises(
        AssemblyError, match=r"assembly\.yaml cannot be read: it is nested too deeply"
    ):
        load_assembly(tmp_path)
