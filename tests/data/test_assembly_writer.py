from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

from asdfviz.data.assembly import load_assembly
from asdfviz.data.assembly_writer import assembly_document, write_assembly
from asdfviz.datatypes import Assembly
from asdfviz.errors import AssemblyError


@pytest.fixture
def clamp() -> Assembly:
    return load_assembly("corner_clamp")


def assert_same(a: Assembly, b: Assembly) -> None:
    for field in ("name", "title", "base", "transitions", "detector_classes"):
        assert getattr(a, field) == getattr(b, field), field
    assert list(a.parts) == list(b.parts)
    for one, two in zip(a.parts.values(), b.parts.values(), strict=True):
        np.testing.assert_allclose(one.mesh.vertices, two.mesh.vertices, atol=1e-8)
        np.testing.assert_array_equal(one.mesh.faces, two.mesh.faces)
        np.testing.assert_allclose(one.keypoints, two.keypoints, atol=1e-8)
        np.testing.assert_array_equal(one.color, two.color)
        assert (one.obj_id, one.detector_class) == (two.obj_id, two.detector_class)
        np.testing.assert_allclose(
            one.symmetries.transforms(step=1.0), two.symmetries.transforms(step=1.0), atol=1e-8
        )
    for one, two in zip(a.states, b.states, strict=True):
        for field in ("index", "name", "is_error", "after", "detector_class", "attached"):
            assert getattr(one, field) == getattr(two, field), (one.name, field)
        for name, T in one.T_base_part.items():
            np.testing.assert_allclose(T, two.T_base_part[name], atol=1e-8)
        assert list(one.joints) == list(two.joints)
        for name, joint in one.joints.items():
            assert (joint.kind, joint.link) == (two.joints[name].kind, two.joints[name].link)
            for field in ("axis", "origin", "slide", "turn"):
                np.testing.assert_allclose(
                    getattr(joint, field), getattr(two.joints[name], field), atol=1e-8
                )


def test_written_and_read_is_the_same(clamp: Assembly, tmp_path: Path) -> None:
    file = write_assembly(clamp, tmp_path / "copy")
    assert_same(load_assembly(file), clamp)


def test_copies_share_a_file_and_gears_their_link(tmp_path: Path) -> None:
    for name in ("screw_clamp", "geared_caliper"):
        assert_same(
            load_assembly(write_assembly(load_assembly(name), tmp_path)), load_assembly(name)
        )
    clamp = load_assembly("corner_clamp")
    twin = dataclasses.replace(clamp.parts["bolt"], name="bolt-Copy", obj_id=4)
    twice = dataclasses.replace(clamp, parts={**clamp.parts, "bolt-Copy": twin})
    read = load_assembly(write_assembly(twice, tmp_path / "twice"))
    assert len(list((tmp_path / "twice" / "parts").iterdir())) == 3
    assert read.parts["bolt-Copy"].detector_class == "bolt"
    np.testing.assert_array_equal(read.parts["bolt-Copy"].mesh.faces, read.parts["bolt"].mesh.faces)


def test_what_differs_from_the_usual_survives(clamp: Assembly, tmp_path: Path) -> None:
    parts = dict(clamp.parts)
    shifted = clamp.parts["jaw"].keypoints + 0.001
    parts["jaw"] = dataclasses.replace(parts["jaw"], keypoints=shifted, detector_class="wedge")
    turned = np.array(
        [[-1, 0, 0, 0.002], [0, -1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], dtype=np.float64
    )
    symmetries = dataclasses.replace(parts["jaw"].symmetries, discrete=(turned,))
    parts["jaw"] = dataclasses.replace(parts["jaw"], symmetries=symmetries)
    states = list(clamp.states)
    states[1] = dataclasses.replace(states[1], detector_class="step one")
    lost = {n: T for n, T in states[2].T_base_part.items() if n != "jaw"}
    states[3] = dataclasses.replace(
        states[3],
        name="no_jaw",
        after=2,
        T_base_part=lost,
        joints={"bolt": states[2].joints["bolt"]},
    )
    odd = dataclasses.replace(
        clamp,
        parts=parts,
        states=tuple(states),
        transitions=frozenset({(0, 2), (2, 0)}),
        detector_classes=("base", "wedge", "bolt", "step one", *clamp.detector_classes[4:]),
    )
    assert_same(load_assembly(write_assembly(odd, tmp_path)), odd)


def test_what_the_reader_fills_in_is_left_out(clamp: Assembly) -> None:
    document = assembly_document(clamp)
    assert "transitions" not in document
    assert "keypoints" not in document["parts"]["base"]
    assert "detector_class" not in document["states"][1]
    # A state repeats nothing: the bolt's state says nothing of the jaw.
    assert list(document["states"][2]["poses"]) == ["bolt"]


def test_a_state_that_loses_a_part_is_refused(clamp: Assembly, tmp_path: Path) -> None:
    states = list(clamp.states)
    states[2] = dataclasses.replace(states[2], T_base_part={"base": np.eye(4)}, joints={})
    with pytest.raises(AssemblyError, match="'bolt' loses jaw"):
        write_assembly(dataclasses.replace(clamp, states=tuple(states)), tmp_path)
    assert not list(tmp_path.iterdir())


def test_the_yaml_is_for_people(clamp: Assembly, tmp_path: Path) -> None:
    text = write_assembly(clamp, tmp_path, comment="Made by\na test").read_text()
    assert text.startswith("# Made by\n# a test\nname: corner_clamp\n")
    assert "color: [0, 90, 170]" in text
    assert "-0.0," not in text
    assert yaml.safe_load(text)["unit"] == "mm"
