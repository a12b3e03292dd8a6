"""`asdfviz train-crops`: weights of the network that gives first poses and states from crops."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from asdfviz.cli.progress import progress_bar, stop_on_interrupt


@dataclass(frozen=True)
class TrainCrops:
    """Train the crop network on crops rendered meanwhile; run the same line again to go on where it
    stopped.

    The best weights so far, also of a run that is stopped, lie in the run folder as
    crops.safetensors; put them beside assembly.yaml, and methods take their first poses, and the
    state's looks, from them.

    Example: asdfviz train-crops --assembly corner_clamp --minutes 120 --out runs/crops
    """

    assembly: tuple[str, ...]
    """assembly.yaml, its folder, or a bundled name; one network may know several."""
    out: Path
    """Run folder: checkpoints, pool of crops, log, curve.png and crops.safetensors."""
    validation: tuple[Path, ...] = ()
    """Scene folders with truth, as `asdfviz synth` writes them."""
    scenes: tuple[Path, ...] = ()
    """Scene folders with truth whose parts are shown beside rendered ones: nearer to what is asked later."""
    scene_share: float = 0.4
    """Share of a batch that is cut out of them."""
    empty_share: float = 0.15
    """How often one of these shows a place about a base part in which the part is still missing."""
    start: Path | None = None
    """Weights to begin with (last.pt or crops.safetensors of another run): what its classes share is
    taken over."""
    teach: Literal["all", "names", "poses"] = "all"
    """names: only which part a crop shows; poses: all but that. The rest stays as --start had it."""
    learning_rate: float = 1.5e-3
    """At first; lower where weights that have learnt much are to go on."""
    minutes: float = 60.0
    """Budget, earlier sittings counted in."""
    generators: int = 1
    """Processes that render fresh crops beside the training; with 0 a run on cuda renders itself."""
    threads: int = 1
    """CPU threads of the training itself."""
    batch: int = 128
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
        from asdfviz.train.crop_checkpoint import CROP_WEIGHTS
        from asdfviz.train.crop_config import CropTrainConfig
        from asdfviz.train.crop_session import CropReport, CropSession
        from asdfviz.train.dataset import told_unchecked

        values = {k: v for k, v in vars(self).items() if k not in ("out", "assembly")}
        config = CropTrainConfig(**values, output=self.out, assemblies=self.assembly)
        require_device(self.device)
        refuse_recording(self.out)
        make_folder(self.out)
        if left_out := told_unchecked(self.validation):
            print(f"note: {left_out}", file=sys.stderr)
        with progress_bar("train-crops") as report, stop_on_interrupt() as stop:

            def show(state: CropReport) -> None:
                losses = " ".join(f"{k} {v:.3f}" for k, v in state.losses.items())
                report(round(1000 * state.share), 1000, f"{state.crops_per_s:.0f} crops/s {losses}")
                for found in state.validation:
                    print(found.table(), file=sys.stderr)

            session = CropSession(config)
            finished = session.go(show, stop)
            if finished:
                for found in session.validate():
                    print(found.table(), file=sys.stderr)
        weights = self.out / CROP_WEIGHTS
        if not finished:
            raise Stopped(
                f"the same command goes on from {session.last}; {weights} holds the best so far"
            )
        print(weights)
