"""Work in other processes: the same files, one error, no loss when killed."""

from __future__ import annotations

import hashlib
import os
import pickle
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest
from marked_pieces import Marks, Threads

from asdfviz.datatypes import Assembly
from asdfviz.errors import AsdfvizError, InputError
from asdfviz.synth.images import generate_images
from asdfviz.synth.scene import SceneConfig
from asdfviz.synth.workers import Crew, do_all, spawned

SMALL = SceneConfig(width=96, height=64, distractors=1, duplicates=0)


def contents(folder: Path) -> dict[str, str]:
    return {
        p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in folder.rglob("*")
        if p.is_file()
    }


@pytest.fixture(scope="module")
def alone(toy: Assembly, toy_loaded_once: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("alone")
    generate_images(toy, count=4, seed=9, folder=folder, config=SMALL, masks=True)
    return folder


def test_two_processes_write_the_same_files_as_one(
    toy: Assembly, alone: Path, tmp_path: Path
) -> None:
    told: list[tuple[int, int]] = []
    written = generate_images(
        toy, count=4, seed=9, folder=tmp_path, config=SMALL, masks=True, crew=Crew(2),
        progress=lambda done, total: told.append((done, total)),
    )  # fmt: skip
    assert written == 4
    assert (told[0], told[-1]) == ((0, 4), (4, 4))
    assert len(contents(alone)) == 6 + 4 * 4 + 2 * len(list((alone / "mask").iterdir()))
    assert contents(tmp_path) == contents(alone)


def test_pieces_run_elsewhere_and_once(tmp_path: Path) -> None:
    ticks: list[int] = []
    assert do_all(Marks(tmp_path), range(6), crew=Crew(2), tick=ticks.append)
    workers = {p.read_text() for p in tmp_path.iterdir()}
    assert {p.name for p in tmp_path.iterdir()} == set("012345")
    assert str(os.getpid()) not in workers
    assert ticks == sorted(ticks)
    assert ticks[-1] == 6


LATE = """
import sys
from pathlib import Path
import torch
from asdfviz.synth.workers import Crew, do_all
from marked_pieces import Threads

if __name__ == "__main__":
    do_all(Threads(Path(sys.argv[1])), range(2), crew=Crew(2))
"""


def test_workers_of_a_script_that_imports_torch_share_the_cores(tmp_path: Path) -> None:
    # Spawned processes import the script again, before they can be told how many threads to use.
    script, counts = tmp_path / "script.py", tmp_path / "counts"
    script.write_text(LATE)
    counts.mkdir()
    here = {**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    subprocess.run([sys.executable, str(script), str(counts)], check=True, env=here)
    share = max(1, len(os.sched_getaffinity(0)) // 2)
    assert {p.read_text() for p in counts.iterdir()} == {str(share)}


def test_a_stop_leaves_the_rest_undone(tmp_path: Path) -> None:
    assert not do_all(Marks(tmp_path), range(200), crew=Crew(2), stop=lambda: True)
    assert len(list(tmp_path.iterdir())) < 200
    assert not do_all(Marks(tmp_path), range(3), stop=lambda: True)


@pytest.mark.parametrize(
    ("mishap", "kind", "said"),
    [("error", InputError, "piece 3 is wrong"), ("death", AsdfvizError, "a worker process died")],
)
def test_what_goes_wrong_in_a_worker_is_one_error(
    tmp_path: Path, mishap: str, kind: type[Exception], said: str
) -> None:
    with pytest.raises(kind, match=said):
        do_all(Marks(tmp_path, mishap), range(6), crew=Crew(2))


def test_workers_that_die_of_the_signal_that_stops_the_job_are_no_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def died(*_: object) -> None:
        raise BrokenProcessPool

    monkeypatch.setattr("asdfviz.synth.workers.wait", died)
    assert not do_all(Marks(tmp_path), range(6), crew=Crew(2), stop=lambda: True)


def count_threads(folder: Path) -> None:
    Threads(folder).open()(0, None)


def sleep() -> None:
    time.sleep(60)


def test_processes_beside_a_job_outlive_sigterm_until_it_ends() -> None:
    with spawned(sleep, [()]) as (process,):
        process.terminate()
        process.join(timeout=0.5)
        assert process.is_alive()
    assert process.exitcode == -signal.SIGKILL


def test_processes_beside_a_job_import_torch_with_one_thread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "2")
    with spawned(count_threads, [(tmp_path,)]) as (process,):
        process.join()
    assert (tmp_path / "0").read_text() == "1"


@pytest.mark.parametrize(
    ("crew", "said"),
    [(Crew(0), "0 workers"), (Crew(2, "slurm"), "no joblib backend 'slurm'; use loky, dask, ray")],
)
def test_impossible_crews_are_refused(tmp_path: Path, crew: Crew, said: str) -> None:
    with pytest.raises(InputError, match=said):
        do_all(Marks(tmp_path), range(2), crew=crew)


def test_joblib_does_the_same(tmp_path: Path) -> None:
    assert do_all(Marks(tmp_path), range(4), crew=Crew(2, "loky"))
    assert {p.name for p in tmp_path.iterdir()} == set("0123")
    assert str(os.getpid()) not in {p.read_text() for p in tmp_path.iterdir()}


KILLED = """
import pickle
import sys
from pathlib import Path
from asdfviz.synth.images import generate_images
from asdfviz.synth.scene import SceneConfig

toy = pickle.loads(Path(sys.argv[1]).read_bytes())
generate_images(toy, count=500, seed=9, folder=Path(sys.argv[2]),
    config=SceneConfig(width=96, height=64, distractors=1, duplicates=0))
"""


@pytest.mark.usefixtures("toy_loaded_once", "shapes_unchecked")
def test_a_killed_job_goes_on_to_the_same_images(toy: Assembly, tmp_path: Path) -> None:
    killed, whole, kept = tmp_path / "killed", tmp_path / "whole", tmp_path / "toy.pickle"
    kept.write_bytes(pickle.dumps(toy))
    with subprocess.Popen([sys.executable, "-c", KILLED, str(kept), str(killed)]) as job:
        while not (killed / "records" / "000000.json").is_file():
            assert job.poll() is None
            time.sleep(0.02)
        job.send_signal(signal.SIGKILL)
    there = len(list((killed / "records").glob("0*.json")))
    assert 1 <= there < 500
    for folder in (killed, whole):
        generate_images(toy, count=there + 1, seed=9, folder=folder, config=SMALL)
    cut_off = {name for name in contents(killed) if Path(name).name.startswith(".")}
    assert {n: h for n, h in contents(killed).items() if n not in cut_off} == contents(whole)
