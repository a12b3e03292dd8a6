"""Test sets: what is written, drawn again by the other renderer, taken up and refused."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from asdfviz.cli.synth import SynthTestset
from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.synth.description import Ground
from asdfviz.synth.images import TEST_SEEDS
from asdfviz.synth.primitives import box
from asdfviz.synth.rerender import ground_mesh, stretched
from asdfviz.synth.testset import SETS, SequenceWork, SetsConfig, generate_testset
from asdfviz.synth.workers import Crew

SMALL = SetsConfig(only="table1", width=128, height=72, frames_per_state=1)


@pytest.fixture(scope="module")
def toy(toy: Assembly, tmp_path_factory: pytest.TempPathFactory) -> Assembly:
    """The toy with a file, whose content the record of a test set names."""
    file = tmp_path_factory.mktemp("toy") / "assembly.yaml"
    file.write_text("name: toy")
    return replace(toy, path=str(file))


@pytest.fixture(scope="module")
def home(
    toy: Assembly,
    tmp_path_factory: pytest.TempPathFactory,
    unchecked: Callable[[], AbstractContextManager[None]],
) -> Path:
    folder = tmp_path_factory.mktemp("sets")
    told: list[tuple[int, int]] = []
    with unchecked():
        found = generate_testset(
            toy, folder=folder, config=SMALL, command="typed",
            progress=lambda done, total: told.append((done, total)),
        )  # fmt: skip
    assert found is not None
    assert found == folder / "toy"
    assert told[-1][0] == told[-1][1]
    return found


def picture(path: Path) -> np.ndarray:
    found = cv2.imread(str(path))
    assert found is not None
    return found.astype(float)


def test_the_plain_set_has_the_same_truth_and_other_pictures(home: Path) -> None:
    for name in ("scene_gt.json", "scene_gt_info.json", "states.json", "camera.json"):
        assert (home / "table1_plain" / name).read_bytes() == (home / "table1" / name).read_bytes()
    for room in ("depth", "labels"):
        for file in (home / "table1" / room).iterdir():
            assert (home / "table1_plain" / room / file.name).read_bytes() == file.read_bytes()
    info = json.loads((home / "table1" / "scene_gt_info.json").read_text())
    for frame, entries in info.items():
        shaded, plain = (
            picture(home / name / "rgb" / f"{int(frame):06d}.jpg")
            for name in ("table1", "table1_plain")
        )
        assert np.abs(shaded - plain).mean() > 1
        # The plain picture shows the base where the truth says, and not the black of emptiness.
        x, y, w, h = entries[0]["bbox_visib"]
        assert plain[y : y + h, x : x + w].max(axis=2).mean() > 15


def test_the_record_names_seeds_and_command(home: Path) -> None:
    about = json.loads((home / "testset.json").read_text())
    assert list(about["sets"]) == ["table1", "table1_plain"]
    for name, entry in about["sets"].items():
        assert entry["seed"] == TEST_SEEDS.start
        assert entry["command"] == "typed"
        assert entry["frames"] == len(list((home / name / "rgb").iterdir())) >= 3
    assert about["sets"]["table1_plain"]["renderer"] == "pyrender"
    sequence = json.loads((home / "table1" / "sequence.json").read_text())
    assert sequence["seed"] == TEST_SEEDS.start
    assert {e["is_error"] for e in json.loads((home / "table1" / "states.json").read_text())} == {
        False
    }


def test_a_finished_test_set_stays(home: Path, toy: Assembly) -> None:
    before = {p: p.stat().st_mtime_ns for p in home.rglob("*") if p.suffix in (".jpg", ".png")}
    assert generate_testset(toy, folder=home.parent, config=SMALL, command="again") == home
    assert {p: p.stat().st_mtime_ns for p in before} == before
    about = json.loads((home / "testset.json").read_text())
    assert about["sets"]["table1"]["command"] == "typed"


@pytest.mark.parametrize(
    ("config", "said"),
    [
        (SetsConfig(only="table1", width=128, height=72), "frames_per_state 1, not None"),
        (SetsConfig(seed=1, width=128, height=72, frames_per_state=1), "seed 0, not 1"),
        (SetsConfig(seed=-1), "seed -1: test sets take 0 to 99999"),
        (SetsConfig(frames_per_state=0), "0 frames a state"),
        (SetsConfig(width=20), "image size 20x720"),
    ],
)
def test_other_settings_are_refused(
    home: Path, toy: Assembly, config: SetsConfig, said: str
) -> None:
    with pytest.raises(InputError, match=said):
        generate_testset(toy, folder=home.parent, config=config)


def test_a_folder_with_other_things_is_refused(tmp_path: Path, toy: Assembly) -> None:
    (tmp_path / "toy" / "holidays").mkdir(parents=True)
    with pytest.raises(InputError, match="holds something else \\(holidays\\)"):
        generate_testset(toy, folder=tmp_path, config=SMALL)
    with pytest.raises(InputError, match="0 workers"):
        generate_testset(toy, folder=tmp_path / "new", config=SMALL, crew=Crew(0))


def test_a_stopped_test_set_says_so(tmp_path: Path, toy: Assembly) -> None:
    assert generate_testset(toy, folder=tmp_path, config=SMALL, stop=lambda: True) is None


def test_other_machines_can_share_the_sequences(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    crews: list[object] = []

    def generate(*_: object, folder: Path, **options: object) -> Path:
        crews.append(options["crew"])
        return folder

    monkeypatch.setattr("asdfviz.synth.testset.generate_testset", generate)
    SynthTestset("corner_clamp", tmp_path, workers=3, joblib_backend="dask")()
    assert crews == [Crew(3, "dask")]


def test_the_sequences_can_be_sent_to_another_process(tmp_path: Path, toy: Assembly) -> None:
    work = pickle.loads(pickle.dumps(SequenceWork(toy, tmp_path, SMALL, "cpu")))
    assert (work.home, work.config, work.assembly.name) == (tmp_path, SMALL, toy.name)


def test_every_sequence_has_a_seed_of_its_own() -> None:
    names = [name for kind in SETS.values() for name in kind]
    seeds = {SetsConfig(seed=s).seed_of(n) for s in (0, 1, 99_999) for n in names}
    assert len(seeds) == 3 * len(names)
    assert all(seed in TEST_SEEDS for seed in seeds)


def _ground(**options: object) -> Ground:
    flat = {"height": -0.1, "edges": np.zeros((0, 3)), "macro": ("wood", 0), "micro": ("noise", 0)}
    rest = {"colors": np.full((3, 3), 0.2), "angle": 0.0, "offset": (0.0, 0.0)}
    return Ground(**{**flat, **rest, **options})  # pyright: ignore[reportArgumentType]


def _area(ground: Ground) -> float:
    mesh = ground_mesh(ground, np.array([0.5, 0.0]))
    assert np.allclose(mesh.vertices[:, 2], -0.1)
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return float(np.cross(b - a, c - a)[:, 2].sum() / 2)


def test_grounds_are_cut_to_their_outlines() -> None:
    assert _area(_ground()) == pytest.approx(36)
    assert _area(_ground(circle=(0.1, 0.2, 0.5))) == pytest.approx(np.pi / 4, rel=2e-3)
    edges = np.array([[1.0, 0, 0.4], [-1, 0, 0.1], [0, 1, 0.3], [0, -1, 0.3], [1, 1, 0.5]])
    assert _area(_ground(edges=edges)) == pytest.approx(0.5 * 0.6 - 0.2 * 0.2 / 2)
    half = _ground(circle=(0.1, 0.2, 0.5), edges=np.array([[1.0, 0, 0.1]]))
    assert _area(half) == pytest.approx(np.pi / 8, rel=2e-3)


def test_mirrored_meshes_still_look_outwards() -> None:
    mesh = stretched(box((0.2, 0.4, 0.6)), np.array([-1.0, 2.0, 1.0]))
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    volume = float((a * np.cross(b, c)).sum() / 6)
    assert volume == pytest.approx(0.2 * 0.8 * 0.6)
