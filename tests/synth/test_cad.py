"""Our own assembly: printable parts that fit, and committed files that are what the code makes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold
from manifold3d import Mesh as SolidMesh
from scipy.spatial import KDTree

from asdfviz.data.assembly import load_assembly
from asdfviz.data.resources import models_folder
from asdfviz.datatypes import Assembly, Mesh
from asdfviz.errors import AssemblyError
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.transforms import apply, rotation_about
from asdfviz.synth.cad import OWN_ASSEMBLIES, own_assembly, solid_mesh, write_own_assembly


@pytest.fixture(scope="module", params=sorted(OWN_ASSEMBLIES))
def own(request: pytest.FixtureRequest) -> Assembly:
    return own_assembly(request.param)


def solid(mesh: Mesh, T: np.ndarray) -> Manifold:
    """The part as a solid in the base's frame, millimetres."""
    vertices = np.asarray(apply(T, mesh.vertices) * 1e3, dtype=np.float32)
    found = Manifold(SolidMesh(vertices, mesh.faces.astype(np.uint32)))
    assert found.volume() > 0
    return found


def test_committed_files_are_what_the_code_makes(own: Assembly, tmp_path: Path) -> None:
    committed = models_folder() / own.name
    write_own_assembly(own.name, tmp_path)
    made = {p.relative_to(tmp_path) for p in tmp_path.rglob("*") if p.is_file()}
    kept = {p.relative_to(committed) for p in (committed / "parts").iterdir()}
    assert {p for p in made if p.parts[0] == "parts"} == kept
    assert (tmp_path / "assembly.yaml").read_text() == (committed / "assembly.yaml").read_text()
    new, old = load_assembly(tmp_path), load_assembly(committed)
    for name, part in new.parts.items():
        np.testing.assert_array_equal(part.mesh.faces, old.parts[name].mesh.faces)
        np.testing.assert_allclose(
            part.mesh.vertices, old.parts[name].mesh.vertices, rtol=0, atol=1e-6
        )


def test_parts_can_be_printed_and_rendered(own: Assembly) -> None:
    total = 0
    for name, part in own.parts.items():
        surface = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)
        assert surface.is_watertight, name
        assert surface.is_winding_consistent, name
        assert surface.volume > 1e-6, name
        assert 0.03 < part.diameter < 0.15, name
        total += len(part.mesh.faces)
    assert total <= 6500


def test_joined_parts_touch_but_do_not_penetrate(own: Assembly) -> None:
    for state in own.states:
        solids = {n: solid(own.parts[n].mesh, T) for n, T in state.T_base_part.items()}
        names = list(solids)
        for i, a in enumerate(names):
            for b in names[i + 1 :]:
                overlap = (solids[a] ^ solids[b]).volume()
                assert overlap < 0.1, f"{state.name}: {a} and {b} share {overlap:.2f} mm3"
        for name in names[1:]:
            gaps = [solids[name].min_gap(solids[other], 5.0) for other in names if other != name]
            assert min(gaps) < 1.0, f"{state.name}: {name} touches nothing"


def test_parts_stay_apart_along_their_slide(own: Assembly) -> None:
    """Threads that slide unturned cut 0.8 mm into each other at most; anything else must not."""
    for state in own.states:
        solids = {n: solid(own.parts[n].mesh, T) for n, T in state.T_base_part.items()}
        for end in (0, 1):
            moved = dict(solids)
            for name, joint in state.joints.items():
                moved[name] = solids[name].translate(tuple(joint.axis * joint.slide[end] * 1e3))
            names = list(moved)
            for i, a in enumerate(names):
                for b in names[i + 1 :]:
                    allowed = 80.0 if "bolt" in (a, b) and own.base in (a, b) else 0.1
                    assert (moved[a] ^ moved[b]).volume() < allowed, (state.name, a, b, end)


def test_the_error_looks_different_from_every_step(own: Assembly) -> None:
    assert own.errors
    for error in own.errors:
        for step in own.steps:
            if set(step.attached) != set(error.attached):
                continue
            farthest = max(
                np.abs(apply(T, own.parts[n].mesh.vertices)
                       - apply(step.T_base_part[n], own.parts[n].mesh.vertices)).max()
                for n, T in error.T_base_part.items()
            )  # fmt: skip
            assert farthest > 0.02


def test_declared_symmetries_hold_and_others_do_not(own: Assembly) -> None:
    rng = np.random.default_rng(0)
    for name, part in own.parts.items():
        tree = KDTree(surface_points(part.mesh.vertices, part.mesh.faces, 40000))
        probes = surface_points(part.mesh.vertices, part.mesh.faces, 1500, seed=1)

        def misfit(S: np.ndarray, tree: KDTree = tree, probes: np.ndarray = probes) -> float:
            return float(np.percentile(tree.query(apply(S, probes))[0], 95))

        for S in part.symmetries.transforms(step=0.4):
            assert misfit(S) < 0.02 * part.diameter, name
        if part.symmetries.is_symmetric:
            continue
        middle = (part.mesh.vertices.min(axis=0) + part.mesh.vertices.max(axis=0)) / 2
        axes = [*np.eye(3), *rng.normal(size=(10, 3))]
        for axis in axes:
            for angle in (np.pi, np.pi / 2, 2 * np.pi / 3):
                S = np.eye(4)
                S[:3, :3] = rotation_about(axis, angle)
                S[:3, 3] = middle - S[:3, :3] @ middle
                assert misfit(S) > 0.04 * part.diameter, (
                    f"{name} looks the same turned about {axis}"
                )


def test_an_unknown_name_lists_what_there_is() -> None:
    with pytest.raises(AssemblyError, match="corner_clamp"):
        own_assembly("engine")


@pytest.mark.parametrize("cubes", [0, 2])
def test_a_solid_that_is_no_part_is_refused(cubes: int) -> None:
    broken = Manifold()
    for place in range(cubes):
        broken += Manifold.cube((1, 1, 1)).translate((5 * place, 0, 0))
    with pytest.raises(AssemblyError, match="expected one piece"):
        solid_mesh(broken, name="lid")
