"""`asdfviz synth`: training images and assembly sequences with truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from asdfviz.cli.progress import progress_bar, stop_on_interrupt
from asdfviz.errors import Stopped


@dataclass(frozen=True)
class SynthImages:
    """Write scenes: parts loose and joined on a table, distractors, hands, RGB-D with truth.

    Example: asdfviz synth images --assembly corner_clamp --count 500 --out data/train
    """

    assembly: str
    """assembly.yaml, its folder, or a bundled name."""
    out: Path
    """Scene folder to write; images that are there already stay."""
    count: int = 1000
    """Images in all."""
    seed: int = 1000
    """The same seed gives the same images."""
    width: int = 640
    """Image width, pixels."""
    height: int = 360
    """Image height, pixels."""
    packs: bool = False
    """Packs instead of scenes: dozens of single parts and groups an image."""
    device: str = "cpu"
    """Where torch renders: cpu or cuda."""

    def __call__(self) -> None:
        """Generate; Ctrl+C stops after the image in work, the same line goes on."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import make_folder
        from asdfviz.detector.device import require_device
        from asdfviz.synth.images import generate_images
        from asdfviz.synth.packs import PackConfig
        from asdfviz.synth.scene import SceneConfig

        kind = PackConfig if self.packs else SceneConfig
        require_device(self.device)
        make_folder(self.out)
        with progress_bar("images") as report, stop_on_interrupt() as stop:
            written = generate_images(
                load_assembly(self.assembly),
                count=self.count,
                seed=self.seed,
                folder=self.out,
                config=kind(width=self.width, height=self.height),
                progress=lambda done, total: report(done, total, ""),
                stop=stop,
                device=self.device,
            )
        if written < self.count:
            raise Stopped(f"{written} of {self.count} images are in {self.out}")
        print(self.out)


@dataclass(frozen=True)
class SynthSequence:
    """Write a continuous RGB-D sequence of the assembly being put together by a hand.

    Example: asdfviz synth sequence --assembly corner_clamp --seed 77 --out my_sequence
    """

    assembly: str
    """assembly.yaml, its folder, or a bundled name."""
    out: Path
    """Scene folder to write."""
    seed: int = 77
    """The same seed gives the same sequence."""
    frames: int | None = None
    """Frames in all. Default: as many as the pace of the hands needs, which is also the least."""
    fps: float = 10.0
    """Frames a second."""

    def __call__(self) -> None:
        """Generate the sequence."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import make_folder
        from asdfviz.synth.sequences import SequenceConfig, generate_sequence

        make_folder(self.out)
        with progress_bar("sequence") as report, stop_on_interrupt() as stop:
            written = generate_sequence(
                load_assembly(self.assembly),
                seed=self.seed,
                folder=self.out,
                config=SequenceConfig(frames=self.frames, fps=self.fps),
                progress=lambda done, total: report(done, total, ""),
                stop=stop,
            )
            stopped = stop()
        if stopped:
            raise Stopped(f"{written} frames are in {self.out}; the same line goes on")
        print(self.out)


@dataclass(frozen=True)
class Synth:
    """Make synthetic data with exact truth for any assembly."""

    what: (
        Annotated[SynthImages, tyro.conf.subcommand("images")]
        | Annotated[SynthSequence, tyro.conf.subcommand("sequence")]
    )

    def __call__(self) -> None:
        """Make what was chosen."""
        self.what()
