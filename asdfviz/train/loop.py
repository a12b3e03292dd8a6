"""The training loop: `train(config)` runs a budget of minutes or steps and leaves a run folder.

The folder holds last.pt (goes on exactly where it was), best.pt, weights.safetensors (the best so
far, also of a run that was stopped), log.csv, validation.csv, validation.json, curve.png and
config.json, and ran.json where the run has a preset; `export_weights` makes weights of a checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from asdfviz.data.assembly import load_assembly
from asdfviz.data.atomic import write_text
from asdfviz.datatypes import Assembly
from asdfviz.train.checkpoint import export_weights as export_weights
from asdfviz.train.config import TrainConfig as TrainConfig
from asdfviz.train.config import check_config
from asdfviz.train.presets import Ran
from asdfviz.train.session import Session, TrainReport
from asdfviz.train.validation import Validation

WEIGHTS = "weights.safetensors"
RAN = "ran.json"


@dataclass(frozen=True, slots=True, eq=False)
class TrainResult:
    """What a run left behind."""

    output: Path
    steps: int
    best_score: float
    validation: Validation | None
    finished: bool
    """False where `stop` ended the run before its budget."""
    weights: Path
    """The best so far, or the last where none was validated."""
    ran: Ran | None = None
    """How much of its preset."""


def train(
    config: TrainConfig,
    *,
    assemblies: Sequence[Assembly] | None = None,
    progress: Callable[[TrainReport], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> TrainResult:
    """Train the detector of one or several assemblies and leave a run folder.

    Started by torchrun, every process calls this with the same config: they train one network, and
    the first one writes.

    Args:
        config: all of the run.
        assemblies: instead of loading config.assemblies.
        progress: called after two seconds, then every 20 s and after every validation.
        stop: asked before every step; True ends the run with a checkpoint.

    Raises:
        InputError: the data or the assembly is wrong, or the loss is no longer finite.
    """
    check_config(config)
    torch.set_num_threads(config.threads)
    run = Session(config, assemblies or [load_assembly(name) for name in config.assemblies])
    finished = run.go(progress or (lambda _: None), stop or (lambda: False))
    found = run.finish() if finished else None
    ran = run.ran(finished=finished)
    best, weights = config.output / "best.pt", config.output / WEIGHTS
    if run.world.is_first:
        if ran is not None:
            write_text(config.output / RAN, ran.as_json())
        export_weights(best if best.is_file() else run.last, weights)
    result = TrainResult(
        output=config.output,
        steps=run.progress.step,
        best_score=run.progress.best,
        validation=found,
        finished=finished,
        weights=weights,
        ran=ran,
    )
    run.world.leave()
    return result
