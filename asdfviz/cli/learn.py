"""`asdfviz train`: weights for an assembly from scene folders with truth."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from asdfviz.cli.progress import progress_bar, stop_on_interrupt

if TYPE_CHECKING:
    from asdfviz.train.config import TrainConfig


@dataclass(frozen=True)
class Train:
    """Train the detector of one or several assemblies; run the same line again to go on where it
    stopped. A run that is stopped leaves its best weights so far.

    Example: asdfviz train --assembly corner_clamp --data data/train --validation data/val --out runs/train
    """

    assembly: tuple[str, ...]
    """assembly.yaml, its folder, or a bundled name; several share one network."""
    out: Path
    """Run folder: checkpoints, log, curve.png, and weights.safetensors once it ends or is stopped."""
    data: tuple[Path, ...] = ()
    """Scene folders with truth, as `asdfviz synth` writes them, of all the assemblies."""
    fresh: int = 0
    """Also render scenes and packs while training, and draw from the latest so many."""
    fresh_device: str = "cpu"
    """Where they are rendered: with several loaders on one GPU they stand in each other's way."""
    validation: tuple[Path, ...] = ()
    """Scene folders that are never trained on."""
    start: Path | None = None
    """What to begin with (best.pt or last.pt of a run, or weights.safetensors): what fits is
    taken over."""
    scale: Literal["n", "s", "m", "l", "x", "x-p6"] = "n"
    """Size of the network."""
    keypoint_width: int = 72
    """Channels of the keypoint branch; 0 is the public width, 72 keeps size n under 7 MB."""
    minutes: float = 60.0
    """Budget, earlier sittings counted in; with a preset the run ends at what comes first."""
    preset: Literal["paper"] | None = None
    """paper: its loss, one in five pictures of data (of 20,000 an assembly) to validate on, 300 epochs,
    ended after 50 that made nothing better. What share of that ran is told."""
    image_size: int = 640
    """Longer side of the input, pixels; infer at the same. The first 30 % of the budget take half of it."""
    threads: int = 1
    """CPU threads."""
    loaders: int = 1
    """Threads that make batches (with fresh: processes, which also render); a GPU wants nearly as
    many as there are cores."""
    loss: Literal["mix", "oks", "paper"] | None = None
    """Keypoint loss: our mix (unless a preset says another), the public OKS, or the paper's L2."""
    keypoint_gain: float = 1.0
    """Factor on it; 0.12 where poses come from crops and many parts are to be found soon."""
    device: str = "cpu"
    """cpu or cuda."""
    seed: int = 0
    """Of weights and augmentation."""

    def __call__(self) -> None:
        """Train, and print where the best weights are."""
        from asdfviz.data.atomic import make_folder
        from asdfviz.data.run_files import refuse_recording
        from asdfviz.detector.device import require_device
        from asdfviz.errors import Stopped
        from asdfviz.train.dataset import told_unchecked
        from asdfviz.train.loop import train
        from asdfviz.train.session import TrainReport

        config = self._config()
        for device in (self.device, self.fresh_device):
            require_device(device)
        refuse_recording(self.out)
        make_folder(self.out)
        if left_out := told_unchecked((*self.data, *self.validation)):
            print(f"note: {left_out}", file=sys.stderr)
        with progress_bar("train") as report, stop_on_interrupt() as stop:

            def show(state: TrainReport) -> None:
                losses = " ".join(f"{k} {v:.2f}" for k, v in state.losses.items())
                report(round(1000 * state.share), 1000, f"{state.inputs_per_s:.0f} img/s {losses}")
                if state.validation is not None:
                    print(state.validation.table(), file=sys.stderr)
                    if state.ran is not None:
                        print(state.ran.text(), file=sys.stderr)

            result = train(config, progress=show, stop=stop)
        if result.ran is not None:
            print(result.ran.text(), file=sys.stderr)
        if not result.finished:
            raise Stopped(
                f"the same command goes on from {self.out / 'last.pt'}; {result.weights} holds the "
                "best so far"
            )
        print(result.weights)

    def _config(self) -> TrainConfig:
        from asdfviz.errors import InputError
        from asdfviz.train.config import TrainConfig
        from asdfviz.train.presets import paper_preset

        own = ("out", "assembly", "preset", "loss")
        values = {k: v for k, v in vars(self).items() if k not in own}
        loss = self.loss or "mix"
        config = TrainConfig(**values, assemblies=self.assembly, output=self.out, loss=loss)
        if self.preset is None:
            return config
        if self.loss not in (None, "paper"):
            raise InputError(f"the paper preset has a loss of its own: leave --loss {loss} out")
        return paper_preset(config)
