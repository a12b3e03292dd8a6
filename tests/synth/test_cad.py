"""Our own assemblies: printable parts that fit, and committed files that are what the code makes."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from manifold3d import Manifold
from manifold3d import Mesh as SolidMesh
from scipy.spatial import ConvexHull, KDTree

from asdfviz.data.assembly import load_assembly
from asdfviz.data.resources import models_folder
from asdfviz.datatypes import Assembly, Mesh, Part, State
from asdfviz.errors import AssemblyError
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.transforms import apply, rotation_about
from asdfviz.synth.cad import OWN_ASSEMBLIES, own_assembly, solid_mesh, write_own_assembly
from asdfviz.synth.joint_motion import joined_poses

LOOKS_DIFFERENT = 0.025
"""Of a part's diameter: misfit of a turned part that nobody would take for the same."""


@cache
def built(name: str) -> Assembly:
    return own_assembly(name)


@pytest.fixture(params=sorted(OWN_ASSEMBLIES))
def own(request: pytest.FixtureRequest) -> Assembly:
    return built(request.param)


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
    assert sum(p.stat().st_size for p in (committed / "parts").iterdir()) < 450_000
    assert (tmp_path / "assembly.yaml").read_text() == (committed / "assembly.yaml").read_text()
    new, old = load_assembly(tmp_path), load_assembly(committed)
    for name, part in new.parts.items():
        np.testing.assert_array_equal(part.mesh.faces, old.parts[name].mesh.faces)
        np.testing.assert_allclose(
            part.mesh.vertices, old.parts[name].mesh.vertices, rtol=0, atol=1e-6
        )


def shapes(own: Assembly) -> dict[str, Part]:
    """One part a shape, by detector class."""
    return {p.detector_class: p for p in reversed(list(own.parts.values()))}


def test_parts_can_be_printed_and_rendered(own: Assembly) -> None:
    for name, part in shapes(own).items():
        surface = trimesh.Trimesh(part.mesh.vertices, part.mesh.faces, process=False)
        assert surface.is_watertight, name
        assert surface.is_winding_consistent, name
        assert surface.body_count == 1, name
        assert 0.015 < part.diameter < 0.18, name
        assert resting_area(surface) > 45e-6, f"{name} has no face to print it on"
        if own.name != "corner_clamp":  # its knurl and its grooves are finer
            assert thin_share(surface, 1.2e-3) < 0.01, name
    assert sum(len(part.mesh.faces) for part in own.parts.values()) <= 20_000


def resting_area(surface: Any) -> float:
    """The largest flat face that a part can stand on, m2: of faces on the convex hull's planes."""
    best = 0.0
    for normal in np.unique(surface.convex_hull.face_normals.round(4), axis=0):
        height = surface.triangles @ normal
        lies = (height > height.max() - 1e-5).all(axis=1)
        best = max(best, float(surface.area_faces[lies].sum()))
    return best


def thin_share(surface: Any, thickness: float) -> float:
    """Share of the surface whose opposite parallel face lies nearer than that, through material."""
    samples: Any = trimesh.sample.sample_surface(surface, 250, seed=4)
    points, faces = samples[0], samples[1]
    corners = surface.triangles
    edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    thin = 0
    for point, ray in zip(points, -surface.face_normals[faces], strict=True):
        opposite = np.flatnonzero(surface.face_normals @ ray > 0.95)
        a, b, s = edges[0][opposite], edges[1][opposite], point - corners[opposite, 0]
        p, q = np.cross(ray, b), np.cross(s, a)
        scale = 1.0 / (a * p).sum(axis=1)
        u, v, t = (s * p).sum(axis=1) * scale, q @ ray * scale, (b * q).sum(axis=1) * scale
        thin += bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6) & (t < thickness)).any())
    return thin / len(points)


def overlaps(own: Assembly, poses: Mapping[str, np.ndarray]) -> dict[tuple[str, str], float]:
    """What pairs of parts share, mm3."""
    solids = {n: solid(own.parts[n].mesh, T) for n, T in poses.items()}
    return {(a, b): (solids[a] ^ solids[b]).volume() for a, b in combinations(solids, 2)}


def changes(own: Assembly, state: State) -> list[str]:
    """What is joined otherwise than in the state before."""
    before = own.states[state.completed if state.is_error else max(state.index - 1, 0)]
    return [
        n
        for n, T in state.T_base_part.items()
        if n not in before.T_base_part or not np.array_equal(T, before.T_base_part[n])
    ]


def test_joined_parts_touch_but_do_not_penetrate(own: Assembly) -> None:
    for state in own.states[1:]:
        solids = {n: solid(own.parts[n].mesh, T) for n, T in state.T_base_part.items()}
        new = changes(own, state)
        assert new, f"{state.name} changes nothing"
        for name in new:
            others = [n for n in solids if n != name]
            for other in others:
                shared = (solids[name] ^ solids[other]).volume()
                assert shared < 0.1, f"{state.name}: {name} and {other} share {shared:.2f} mm3"
            gap = min(solids[name].min_gap(solids[other], 2.0) for other in others)
            assert gap < 0.6, f"{state.name}: {name} touches nothing"


def test_parts_stay_apart_wherever_their_joints_are(own: Assembly) -> None:
    """The corner clamp's bolt, whose turn does not follow its travel, cuts into the nut's thread."""
    for state in (own.steps[-1], *own.errors):
        for seed in range(4):
            poses = joined_poses(state, np.random.default_rng(seed))
            for pair, shared in overlaps(own, poses).items():
                free_thread = own.name == "corner_clamp" and pair == ("base", "bolt")
                assert shared < (120.0 if free_thread else 0.5), (state.name, pair, seed, shared)


def test_nothing_reaches_under_the_base(own: Assembly) -> None:
    """So that whatever is joined, and however it is moved, the base can stand on a table."""
    floor = own.parts[own.base].mesh.vertices[:, 2].min()
    for state in own.states:
        for seed in range(4):
            for name, T in joined_poses(state, np.random.default_rng(seed)).items():
                lowest = apply(T, own.parts[name].mesh.vertices)[:, 2].min()
                assert lowest > floor - 1e-4, (state.name, name, seed)


def test_every_state_stands_on_the_bases_underside(own: Assembly) -> None:
    surfaces = {
        n: trimesh.Trimesh(p.mesh.vertices, p.mesh.faces, process=False)
        for n, p in own.parts.items()
    }
    for state in own.states:
        points = np.concatenate(
            [apply(T, own.parts[n].mesh.vertices) for n, T in state.T_base_part.items()]
        )
        centers = [apply(T, surfaces[n].center_mass[None])[0] for n, T in state.T_base_part.items()]
        weights = [surfaces[n].volume for n in state.T_base_part]
        middle = np.average(centers, axis=0, weights=weights)
        contacts = points[points[:, 2] < points[:, 2].min() + 2e-4, :2]
        edges = ConvexHull(contacts).equations
        inside = -(edges[:, :2] @ middle[:2] + edges[:, 2]).max()
        assert inside > 0.002, f"{state.name} tips over"


def test_a_gear_out_of_step_would_cut_into_its_neighbour() -> None:
    caliper = built("geared_caliper")
    poses = dict(caliper.steps[2].T_base_part)
    assert max(overlaps(caliper, poses).values()) < 0.1
    poses["pinion"] = poses["pinion"] @ turned(np.array([0.0, 0.0, 1.0]), np.pi / 12)
    assert overlaps(caliper, poses)["rule", "pinion"] > 20.0


def test_copies_share_shape_and_class() -> None:
    clamp = built("screw_clamp")
    for name in ("pad", "rod", "knob", "pin"):
        one, two = clamp.parts[name], clamp.parts[f"{name}-Copy"]
        assert one.mesh is two.mesh
        assert one.detector_class == two.detector_class == name
        assert one.obj_id != two.obj_id
    assert len(clamp.parts) == 10
    assert sum(c in clamp.parts for c in clamp.detector_classes) == 6


@pytest.mark.parametrize(
    ("name", "steps"),
    [("corner_clamp", 3), ("geared_caliper", 5), ("vise", 8), ("screw_clamp", 10)],
)
def test_as_many_states_as_the_papers_assemblies(name: str, steps: int) -> None:
    own = built(name)
    assert len(own.steps) == steps
    assert set(own.steps[-1].attached) == set(own.parts)
    assert len(own.errors) >= (1 if name == "corner_clamp" else 3)


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
            assert farthest > 0.015


def test_declared_symmetries_hold_and_others_do_not(own: Assembly) -> None:
    rng = np.random.default_rng(0)
    for name, part in shapes(own).items():
        tree = KDTree(surface_points(part.mesh.vertices, part.mesh.faces, 20000))
        probes = surface_points(part.mesh.vertices, part.mesh.faces, 300, seed=1)

        far = 0.1 * part.diameter
        for S in part.symmetries.transforms(step=0.4):
            assert misfit(tree, apply(S, probes), 90, far) < 0.02 * part.diameter, name
        middle = (part.mesh.vertices.min(axis=0) + part.mesh.vertices.max(axis=0)) / 2
        axes = [*np.eye(3), *rng.normal(size=(10, 3))]
        for axis in axes[:2] + axes[3:] if part.symmetries.is_symmetric else axes:
            for angle in (np.pi, np.pi / 2, 2 * np.pi / 3):
                S = turned(axis / np.linalg.norm(axis), angle)
                S[:3, 3] = middle - S[:3, :3] @ middle
                assert misfit(tree, apply(S, probes), 95, far) > LOOKS_DIFFERENT * part.diameter, (
                    f"{name} looks the same turned about {axis}"
                )


def misfit(tree: KDTree, points: np.ndarray, percentile: int, far: float) -> float:
    """Distance to the surface that so many of the points keep, cut off at `far`."""
    distances = tree.query(points, distance_upper_bound=far)[0]
    return float(np.percentile(np.minimum(distances, far), percentile))


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = rotation_about(axis, angle)
    return T


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
