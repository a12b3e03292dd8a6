"""`asdfviz train-masks`: weights of the mask branch beside a trained detector."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from asdfviz.cli.progress import progress_bar, stop_on_interrupt


@dataclass(frozen=True)
class TrainMasks:
    """Train a mask branch beside a trained detector, which stays as it is; run the same line again
    to go on where it stopped. A run that is stopped leaves its weights, not validated.

    Put masks.safetensors beside the detector's weights, and the method asdf_seg finds it.

    Example: asdfviz train-masks --assembly corner_clamp --data data/packs --out runs/masks
    """

    assembly: tuple[str, ...]
    """assembly.yaml, its folder, or a bundled name; all that the detector knows, in its order."""
    out: Path
    """Run folder: checkpoint, log, curve.png, and masks.safetensors once it ends or is stopped."""
    data: tuple[Path, ...]
    """Scene folders with masks, as `asdfviz synth packs --masks` writes them."""
    validation: tuple[Path, ...] = ()
    """Scene folders with masks that are never trained on."""
    weights: Path | None = None
    """Of the detector. Default: those that methods take for the first assembly."""
    start: Path | None = None
    """masks.safetensors to begin with, also of another detector: a new one wants masks of its own."""
    minutes: float = 30.0
    """Budget, earlier sittings counted in."""
    batch: int = 4
    """Inputs a step."""
    threads: int = 1
    """CPU threads."""
    device: str = "cpu"
    """cpu or cuda."""
    seed: int = 0
    """Of weights and augmentation."""

    def __call__(self) -> None:
        """Train, export the weights, print how good they are and where."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import make_folder
        from asdfviz.data.run_files import refuse_recording
        from asdfviz.detector.device import require_device
        from asdfviz.errors import InputError, Stopped
        from asdfviz.methods.network import NetworkConfig, weights_path
        from asdfviz.train.mask_checkpoint import MASK_WEIGHTS
        from asdfviz.train.mask_config import MaskTrainConfig
        from asdfviz.train.mask_session import MaskReport, MaskSession

        if not self.assembly:
            raise InputError("no assembly named: give those of the detector, in its order")
        first = load_assembly(self.assembly[0])
        config = MaskTrainConfig(
            assemblies=self.assembly,
            detector=weights_path(NetworkConfig(weights=self.weights), first),
            data=self.data,
            output=self.out,
            validation=self.validation,
            start=self.start,
            minutes=self.minutes,
            batch=self.batch,
            threads=self.threads,
            device=self.device,
            seed=self.seed,
        )
        require_device(self.device)
        refuse_recording(self.out)
        make_folder(self.out)
        with progress_bar("train-masks") as report, stop_on_interrupt() as stop:

            def show(state: MaskReport) -> None:
                losses = " ".join(f"{k} {v:.3f}" for k, v in state.losses.items())
                report(round(1000 * state.share), 1000, f"{state.inputs_per_s:.1f} img/s {losses}")

            session = MaskSession(config)
            finished = session.go(show, stop)
        weights = self.out / MASK_WEIGHTS
        if not finished:
            raise Stopped(
                f"the same command goes on from {session.last}; {weights} holds what it has learnt"
            )
        found = session.finish()
        if found is not None:
            print(found.table(), file=sys.stderr)
        print(weights)
