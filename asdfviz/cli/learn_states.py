"""`asdfviz train-states`: weights of the network that tells the state from the base part's pose and a crop."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from asdfviz.cli.progress import progress_bar, stop_on_interrupt


@dataclass(frozen=True)
class TrainStates:
    """Train the state network on crops of joined groups rendered meanwhile; run the same line again to
    go on where it stopped.

    The best weights so far, also of a run that is stopped, lie in the run folder as
    states.safetensors; put them beside assembly.yaml, and methods take the state's looks from them.

    Example: asdfviz train-states --assembly corner_clamp --start models/crops.safetensors --out runs/states
    """

    assembly: tuple[str, ...]
    """assembly.yaml, its folder, or a bundled name; one network may know several."""
    out: Path
    """Run folder: checkpoints, pool of crops, log, curve.png and states.safetensors."""
    start: Path | None = None
    """Weights to begin with: crops.safetensors of the same assemblies (much faster than from nothing),
    or states.safetensors to go on with."""
    validation: tuple[Path, ...] = ()
    """Scene folders with truth, as `asdfviz synth` writes them."""
    scenes: tuple[Path, ...] = ()
    """Scene folders with truth whose groups are shown beside rendered ones: nearer to what is asked later."""
    scene_share: float = 0.5
    """Share of a batch that is cut out of them."""
    learning_rate: float = 1.5e-3
    """At first; lower where weights that have learnt much are to go on."""
    minutes: float = 60.0
    """Budget, earlier sittings counted in."""
    generators: int = 1
    """Processes that render fresh crops beside the training; with 0 a run on cuda renders itself."""
    threads: int = 1
    """CPU threads of the training itself."""
    batch: int = 96
    """Crops a step."""
    device: str = "cpu"
    """cpu or cuda."""
    seed: int = 0
    """Of weights, crops and views."""

    def __call__(self) -> None:
        """Train, and print where the best weights are."""
        from asdfviz.data.atomic import make_folder
        from asdfviz.data.run_files import refuse_recording
        from asdfviz.detector.device import require_device
        from asdfviz.errors import Stopped
        from asdfviz.train.dataset import told_unchecked
        from asdfviz.train.state_checkpoint import STATE_WEIGHTS
        from asdfviz.train.state_config import StateTrainConfig
        from asdfviz.train.state_session import StateReport, StateSession

        values = {k: v for k, v in vars(self).items() if k not in ("out", "assembly")}
        config = StateTrainConfig(**values, output=self.out, assemblies=self.assembly)
        require_device(self.device)
        refuse_recording(self.out)
        make_folder(self.out)
        if left_out := told_unchecked(self.validation):
            print(f"note: {left_out}", file=sys.stderr)
        with progress_bar("train-states") as report, stop_on_interrupt() as stop:

            def show(state: StateReport) -> None:
                losses = " ".join(f"{k} {v:.3f}" for k, v in state.losses.items())
                report(round(1000 * state.share), 1000, f"{state.crops_per_s:.0f} crops/s {losses}")
                for found in state.validation:
                    print(found.line(), file=sys.stderr)

            session = StateSession(config)
            finished = session.go(show, stop)
            if finished:
                for found in session.validate():
                    print(found.line(), file=sys.stderr)
        weights = self.out / STATE_WEIGHTS
        if not finished:
            raise Stopped(
                f"the same command goes on from {session.last}; {weights} holds the best so far"
            )
        print(weights)
