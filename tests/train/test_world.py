from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from asdfviz.data.assembly_writer import write_assembly
from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.train.checkpoint import load_checkpoint
from asdfviz.train.world import World, join_world

LAUNCH = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
SCRIPT = """
import sys
from pathlib import Path

import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.train.config import Stage, TrainConfig
from asdfviz.train.session import Session
from asdfviz.train.world import join_world

folder = Path(sys.argv[1])
world = join_world("cpu")
torch.manual_seed(world.rank)
network = torch.nn.Linear(3, 2)
for parameter in network.parameters():
    parameter.grad = torch.full_like(parameter, float(world.rank + 1))
world.average_gradients(network.parameters())
means = {float(p.grad.unique().item()) for p in network.parameters()}
agreed = world.agree(10.0 + world.rank)
(folder / f"rank{world.rank}").write_text(f"{means} {agreed}")

config = TrainConfig(
    assemblies=("toy",), data=(folder / "scene",), output=folder / "run", steps=3, image_size=320,
    stages=(Stage(1.0, 96, 96, 1, 1.0),), warmup_steps=2, keypoint_width=64,
)
run = Session(config, [load_assembly(folder / "toy")])
finished = run.go(lambda _: None, lambda: False)
run.finish()
weights = torch.cat([p.detach().flatten() for p in run.network.parameters()])
torch.save(weights, folder / f"weights{run.world.rank}.pt")
run.world.leave()
"""


@pytest.fixture(scope="module")
def together(tmp_path_factory: pytest.TempPathFactory, scene: Path, assembly: Assembly) -> Path:
    """The folder that two processes left, which averaged, agreed and trained one network."""
    folder = tmp_path_factory.mktemp("together")
    write_assembly(assembly, folder / "toy")
    shutil.copytree(scene, folder / "scene")
    script = folder / "train.py"
    script.write_text(SCRIPT)
    done = subprocess.run(
        [*LAUNCH, str(script), str(folder)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        timeout=200,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return folder


def test_two_processes_train_one_network(together: Path) -> None:
    first, second = (torch.load(together / f"weights{i}.pt", weights_only=True) for i in range(2))
    assert torch.equal(first, second)
    assert load_checkpoint(together / "run" / "last.pt")["progress"][0] == 3


def test_two_processes_average_and_agree(together: Path) -> None:
    assert [(together / f"rank{i}").read_text() for i in range(2)] == ["{1.5} 10.0"] * 2


def test_alone_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    world = join_world("cpu")
    assert world == World()
    gradient = torch.nn.Parameter(torch.ones(2))
    gradient.grad = torch.tensor([1.0, 2.0])
    world.average_gradients([gradient])
    assert gradient.grad.tolist() == [1.0, 2.0]
    assert world.agree(0.3) == 0.3


def test_a_gradient_that_one_process_lacks_is_averaged_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As where one's batch holds no part: all must send the same number of values."""
    monkeypatch.setattr("torch.distributed.all_reduce", lambda flat: flat.add_(1.0))
    known, missing = torch.nn.Parameter(torch.ones(2)), torch.nn.Parameter(torch.ones(3, 1))
    frozen = torch.nn.Parameter(torch.ones(4), requires_grad=False)
    known.grad = torch.tensor([1.0, 2.0])
    World(size=2).average_gradients([known, frozen, missing])
    assert known.grad.tolist() == [1.0, 1.5]
    assert missing.grad is not None
    assert missing.grad.tolist() == [[0.5]] * 3
    assert frozen.grad is None


def test_half_a_torchrun_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WORLD_SIZE", "2")
    monkeypatch.delenv("RANK", raising=False)
    with pytest.raises(InputError, match="start it with torchrun"):
        join_world("cpu")
