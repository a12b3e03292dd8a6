"""The paper's assemblies: from the folder of derived data, and in the layout of the dataset."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial import KDTree

from asdfviz.data import gbot_import as module
from asdfviz.data.assembly import load_assembly
from asdfviz.data.gbot_facts import FACTS, NANO_VISE
from asdfviz.data.gbot_import import import_gbot
from asdfviz.data.gbot_source import MAX_FACES, GbotSource, decimated
from asdfviz.data.meshes import read_mesh
from asdfviz.data.ply import ply_bytes
from asdfviz.datatypes import Assembly, Mesh
from asdfviz.errors import AssemblyError
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.transforms import apply, inverse

NAMES = ("gbot_nanovise", "gbot_cornerclamp", "gbot_gearedcaliper", "gbot_screwclamp")
NANO_PARTS = (
    "CLAMP_BALLJOINT", "CLAMP_BASE", "CLAMP_HEADPLATE", "CLAMP_NUT", "CLAMP_SCREW",
    "Connector", "VISE_BASE", "VISE_SCREW", "VISE_SLIDER",
)  # fmt: skip


def block(x: float, y: float, z: float) -> Mesh:
    corners = np.array([[i, j, k] for i in (0, x) for j in (0, y) for k in (0, z)], dtype=float)
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    return Mesh(corners, np.array(faces, dtype=np.int32))


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    """The dataset's layout with boxes for parts: NanoVise only, and the authors' own poses."""
    models = tmp_path / "source" / "NanoViseV2" / "model" / "meshes"
    models.mkdir(parents=True)
    for i, name in enumerate(NANO_PARTS):
        mesh = block(0.02 + 0.004 * i, 0.03, 0.05)
        (models / f"NanoViseV2_{name}.ply").write_bytes(ply_bytes(mesh))
    step = {
        "metafile_path": "x.yaml",
        "referenced_bodies": ["NanoViseV2_CLAMP_BASE", "NanoViseV2_CLAMP_SCREW"],
        "Symmetric": 1,
        "R": [0, -1, 0, 1, 0, 0, 0, 0, 1],
        "T": [0.1, 0.2, 0.3],
    }
    config = tmp_path / "source" / "NanoViseV2" / "model" / "tracker_config"
    config.mkdir()
    (config / "assembly_state.json").write_text(json.dumps({"0": step}))
    return tmp_path / "source"


@pytest.fixture(scope="module")
def models(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Assembly]:
    folder = tmp_path_factory.mktemp("models")
    paths = import_gbot(shared / "data" / "gbot", folder)
    assert paths == [folder / name / "assembly.yaml" for name in NAMES]
    return {name: load_assembly(folder / name) for name in NAMES}


@pytest.fixture(scope="module")
def description(shared: Path) -> dict[str, Any]:
    return json.loads((shared / "data" / "gbot" / "assemblies.json").read_text())


@pytest.mark.shared
@pytest.mark.parametrize(("key", "name"), list(zip(FACTS, NAMES, strict=True)))
def test_states_are_those_of_the_description(
    models: dict[str, Assembly], description: dict[str, Any], key: str, name: str
) -> None:
    found = models[name]
    raw = description[key]
    pieces = raw.get("instance_list") or raw["parts"]
    assert set(found.parts) == {p["id"] for p in pieces}
    joined: set[str] = set()
    for index, step in enumerate(raw["states"]):
        joined |= set(step.get("attached", ())) | set(step.get("added", ()))
        short = {n.removeprefix("NanoViseV2_") for n in found.states[index].attached}
        assert short == {n.removeprefix("NanoViseV2_") for n in joined}
    assert len(found.steps) == raw["n_states_asdf"]
    assert found.errors
    for error in found.errors:
        after = found.states[error.completed]
        assert set(after.attached) <= set(error.attached)
    for name_, number in raw.get("state_yolo_class_ids", {}).items():
        assert found.detector_classes[number] == name_
    for piece in pieces:
        kind = piece.get("part", piece["id"])
        assert found.detector_classes[piece["yolo_class"]] == kind
        assert found.parts[piece["id"]].detector_class == kind


@pytest.mark.shared
def test_poses_follow_the_links(models: dict[str, Assembly], description: dict[str, Any]) -> None:
    for key, name in zip(FACTS, NAMES, strict=True):
        found = models[name]
        final = found.steps[-1].T_base_part
        for link in description[key]["links"]:
            T_base_parent, T_base_child = final[link["parent"]], final[link["child"]]
            T_parent_child = inverse(T_base_parent) @ T_base_child
            np.testing.assert_allclose(T_parent_child, link["T_parent_child"], atol=1e-4)


@pytest.mark.shared
def test_given_errors_of_the_screw_clamp(models: dict[str, Assembly]) -> None:
    errors = {e.name: e for e in models["gbot_screwclamp"].errors}
    assert {n: e.completed for n, e in errors.items()} == {
        "missing_hinge": 1,
        "spindle_in_wrong_bore": 1,
        "pad_reversed": 0,
        "missing_pin": 6,
        "spindle_before_hinges": 1,
    }
    assert "HS_Pin-Copy" not in errors["missing_pin"].attached
    assert errors["spindle_in_wrong_bore"].T_base_part["HS_Thread1"][0, 3] == pytest.approx(0.07164)


@pytest.mark.shared
def test_repeated_parts_share_mesh_and_class(models: dict[str, Assembly]) -> None:
    found = models["gbot_screwclamp"]
    pins = [p for n, p in found.parts.items() if n.startswith("HS_Pin")]
    assert len(pins) == 4
    assert {p.detector_class for p in pins} == {"HS_Pin"}
    assert len({p.obj_id for p in pins}) == 4
    assert len(found.parts) == 16
    assert len(found.detector_classes) == 10 + 9 + 5


@pytest.mark.shared
def test_meshes_are_small_and_true(models: dict[str, Assembly], shared: Path) -> None:
    source = GbotSource(shared / "data" / "gbot")
    for part in models["gbot_nanovise"].parts.values():
        assert len(part.mesh.faces) <= MAX_FACES
        kind = part.name
        file = source.files.get(f"{kind}.ply") or source.files[f"{kind}_downsampled.ply"]
        original = read_mesh(file, unit="mm", part=kind)
        points = surface_points(original.vertices, original.faces, 500)
        dense = surface_points(part.mesh.vertices, part.mesh.faces, 30000, seed=1)
        misfit = KDTree(dense).query(points)[0]
        assert np.percentile(misfit, 98) < 1.5e-3, kind
        np.testing.assert_allclose(
            part.mesh.vertices.max(axis=0), original.vertices.max(axis=0), atol=1e-3
        )


@pytest.mark.shared
def test_keypoints_are_the_authors(models: dict[str, Assembly], shared: Path) -> None:
    file = shared / "data/gbot/keypoints17/NanoViseV2/NanoViseV2_VISE_BASE_kps.txt"
    part = models["gbot_nanovise"].parts["NanoViseV2_VISE_BASE"]
    np.testing.assert_allclose(part.keypoints, np.loadtxt(file), atol=1e-8)


@pytest.mark.shared
def test_symmetries_map_each_mesh_onto_itself(models: dict[str, Assembly]) -> None:
    symmetric = 0
    for name in NAMES:
        for part in models[name].parts.values():
            if not part.symmetries.is_symmetric:
                continue
            symmetric += 1
            tree = KDTree(surface_points(part.mesh.vertices, part.mesh.faces, 40000))
            probes = surface_points(part.mesh.vertices, part.mesh.faces, 800, seed=1)
            for S in part.symmetries.transforms(step=1.3):
                misfit = np.percentile(tree.query(apply(S, probes))[0], 95)
                # The light mesh of the nut is itself 2 mm off in places.
                assert misfit < 0.04 * part.diameter, part.name
    assert symmetric == 14


def test_the_datasets_own_poses_come_first(dataset: Path, tmp_path: Path) -> None:
    (path,) = import_gbot(dataset, tmp_path / "models")
    nano = load_assembly(path)
    T_base_screw = nano.states[1].T_base_part["NanoViseV2_CLAMP_SCREW"]
    np.testing.assert_allclose(T_base_screw[:3, 3], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(T_base_screw[:3, :3], [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    # What hangs on the screw went with it.
    T_base_plate = nano.states[2].T_base_part["NanoViseV2_CLAMP_HEADPLATE"]
    np.testing.assert_allclose(T_base_plate[:3, 3], [0.1, 0.2, 0.3 + 0.13506])
    assert len(nano.steps) == 8
    assert nano.parts["NanoViseV2_VISE_BASE"].color.tolist() == [20, 90, 170]


def test_shipped_weights_come_along(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = tmp_path / "shipped"
    (shipped / "gbot_nanovise").mkdir(parents=True)
    for name in ("weights.safetensors", "weights.json"):
        (shipped / "gbot_nanovise" / name).write_text(name)
    (shipped / "gbot").mkdir()
    for name in ("crops.safetensors", "states.safetensors", "masks.safetensors", "weights.json"):
        (shipped / "gbot" / name).write_text(f"joint {name}")
    monkeypatch.setattr(module, "models_folder", lambda: shipped)
    import_gbot(dataset, tmp_path / "models")
    copied = tmp_path / "models" / "gbot_nanovise"
    assert (copied / "weights.safetensors").read_text() == "weights.safetensors"
    assert (copied / "weights.json").read_text() == "weights.json"
    for name in ("crops.safetensors", "states.safetensors", "masks.safetensors"):
        assert (copied / name).read_text() == f"joint {name}"
    # Into the shipped folder itself: nothing to copy, nothing lost.
    import_gbot(dataset, shipped)
    assert (shipped / "gbot_nanovise" / "weights.json").read_text() == "weights.json"


def test_importing_twice_gives_the_same_files(dataset: Path, tmp_path: Path) -> None:
    contents: list[dict[str, bytes]] = []
    for _ in range(2):
        import_gbot(dataset, tmp_path / "models")
        folder = tmp_path / "models"
        contents.append(
            {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}
        )
    assert contents[0] == contents[1]
    networks = ("weights", "crops", "states", "masks")
    made = [name for name in contents[0] if Path(name).stem not in networks]
    assert len(made) == 1 + len(NANO_PARTS)


def test_a_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(AssemblyError, match="give the folder with the GBOT data"):
        import_gbot(tmp_path / "nowhere", tmp_path)


def test_a_folder_without_meshes(tmp_path: Path) -> None:
    with pytest.raises(AssemblyError, match="holds no mesh of any GBOT assembly"):
        import_gbot(tmp_path, tmp_path / "models")
    assert not (tmp_path / "models").exists()
    assert not (tmp_path / "models").exists()


def test_one_missing_mesh_is_named(dataset: Path, tmp_path: Path) -> None:
    next(dataset.rglob("NanoViseV2_CLAMP_NUT.ply")).unlink()
    with pytest.raises(AssemblyError, match=r"'NanoViseV2_CLAMP_NUT'.*_downsampled.ply"):
        import_gbot(dataset, tmp_path / "models")


def test_a_light_mesh_stands_in(dataset: Path, tmp_path: Path) -> None:
    full = next(dataset.rglob("NanoViseV2_CLAMP_NUT.ply"))
    full.rename(full.with_name("NanoViseV2_CLAMP_NUT_downsampled.ply"))
    (path,) = import_gbot(dataset, tmp_path / "models")
    assert "NanoViseV2_CLAMP_NUT" in load_assembly(path).parts


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param("{", "expected states with", id="no JSON"),
        pytest.param('{"0": {"R": []}}', "expected states with", id="no bodies"),
        pytest.param(
            '{"0": {"referenced_bodies": ["a", "b"], "R": [1,1,1,1,1,1,1,1,1], "T": [0,0,0]}}',
            "not a rotation",
            id="no rotation",
        ),
    ],
)
def test_a_broken_assembly_state(dataset: Path, tmp_path: Path, content: str, message: str) -> None:
    next(dataset.rglob("assembly_state.json")).write_text(content)
    with pytest.raises(AssemblyError, match=message):
        import_gbot(dataset, tmp_path / "models")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        pytest.param({"states": [{"id": 1}]}, "stands at place 0", id="gap"),
        pytest.param({"links": []}, "no relative pose of", id="no links"),
        pytest.param({"base_part": "HS_Jaw1"}, "'HS_Jaw1' is not a part", id="base"),
        pytest.param({"links": [{"parent": "x"}]}, "description of NanoVise is wrong", id="link"),
    ],
)
def test_a_broken_description(
    dataset: Path, tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    own = dict(GbotSource(dataset).description["NanoVise"]) | change
    (dataset / "assemblies.json").write_text(json.dumps({"NanoVise": own}))
    with pytest.raises(AssemblyError, match=message):
        import_gbot(dataset, tmp_path / "models")


def test_broken_keypoints_are_named(dataset: Path, tmp_path: Path) -> None:
    (dataset / "NanoViseV2_CLAMP_NUT_kps.txt").write_text("1 2 3\n")
    with pytest.raises(AssemblyError, match=r"NanoViseV2_CLAMP_NUT_kps\.txt have shape"):
        import_gbot(dataset, tmp_path / "models")


def test_decimation_leaves_small_meshes_alone_and_bounds_large_ones() -> None:
    small = block(0.1, 0.05, 0.02)
    assert decimated(small) is small
    steps = 60
    u, v = np.meshgrid(
        np.linspace(0, np.pi, steps), np.linspace(0, 2 * np.pi, steps), indexing="ij"
    )
    points = 0.05 * np.stack([np.sin(u) * np.cos(v), np.sin(u) * np.sin(v), np.cos(u)], axis=-1)
    index = np.arange(steps * steps).reshape(steps, steps)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    quads = [np.stack(q, axis=-1).reshape(-1, 3) for q in ((a, b, c), (a, c, d))]
    ball = Mesh(points.reshape(-1, 3), np.concatenate(quads).astype(np.int32))
    smaller = decimated(ball)
    assert len(smaller.faces) <= MAX_FACES < len(ball.faces)
    on_faces = surface_points(smaller.vertices, smaller.faces, 2000)
    assert np.abs(np.linalg.norm(on_faces, axis=1) - 0.05).max() < 3e-4


def test_the_packaged_description_is_enough(dataset: Path) -> None:
    """It is the shared one without its prose; a source without assemblies.json needs no more."""
    packaged = GbotSource(dataset).description
    assert list(packaged) == ["CornerClamp", "NanoVise", "GearedCaliper", "HandScrewClamp"]
    assert {p["id"] for p in packaged["NanoVise"]["parts"]} >= set(NANO_VISE.symmetries)


@pytest.mark.shared
def test_the_packaged_description_says_the_same(
    models: dict[str, Assembly], shared: Path, tmp_path: Path
) -> None:
    source = tmp_path / "source"
    shutil.copytree(shared / "data" / "gbot" / "light" / "HobbyCornerClamp", source)
    (path,) = import_gbot(source, tmp_path / "models")
    assert_states_equal(load_assembly(path), models["gbot_cornerclamp"])


def assert_states_equal(a: Assembly, b: Assembly) -> None:
    assert a.detector_classes == b.detector_classes
    for one, two in zip(a.states, b.states, strict=True):
        assert (one.name, one.after, one.attached) == (two.name, two.after, two.attached)
        for name, T in one.T_base_part.items():
            # Light and full meshes have slightly different boxes, and so turning points.
            np.testing.assert_allclose(T, two.T_base_part[name], atol=1e-3)
