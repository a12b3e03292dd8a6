"""`asdfviz synth`: training images, assembly sequences and test sets, all with exact truth."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from asdfviz.cli.progress import progress_bar, stop_on_interrupt, with_rate
from asdfviz.cli.synth_images import SynthImages, SynthPacks, photos_in
from asdfviz.errors import Stopped, counted


@dataclass(frozen=True)
class SynthSequence:
    """Write a continuous RGB-D sequence of the assembly being put together by a hand.

    Example: asdfviz synth sequence --assembly corner_clamp --seed 77 --out my_sequence
    """

    assembly: str
    """assembly.yaml, its folder, or a bundled name."""
    out: Path
    """Scene folder to write; frames that are there already stay."""
    seed: int = 77
    """The same seed gives the same sequence; 7000000 to 7999999 belong to test sets."""
    frames: int | None = None
    """Frames in all; hands hurry where there are few, and fewer than they can do with are refused.
    Default: as many as their pace needs."""
    frames_per_state: int | None = None
    """So many frames for each state instead, error states too, but no fewer than its hands and carried
    parts need at their speed; the progress bar says how many that makes before the first is drawn."""
    fps: float = 10.0
    """Frames a second, 3 to 30."""
    every: int = 1
    """Draw each so-manieth frame only: for training, where what looks alike teaches little."""
    condition: Literal["table", "normal", "dynamic", "hand", "blur"] = "table"
    """table: hands assemble. normal: parts move by themselves. dynamic: and the lights travel.
    hand: hands hide much. blur: and the camera sways, with a long shutter."""
    error: str = "any"
    """The error state to make: its name, any, or none."""
    unlisted: bool = False
    """Hold one part to a wrong place that no state lists."""
    width: int = 640
    """Image width, pixels."""
    height: int = 360
    """Image height, pixels."""
    masks: bool = False
    """Write BOP's mask/ and mask_visib/ too."""
    shift: bool = False
    """Shift depth against colour, alike in all frames, as it is in the paper's real frames."""
    device: str = "cpu"
    """Where torch renders: cpu or cuda."""
    grounds: Path | None = None
    """Folder of photos of your own empty table (jpg, png), taken from above; one of them is the
    table."""
    ground_width: float = 0.6
    """Metres that the longer side of such a photo shows."""

    def __call__(self) -> None:
        """Generate the sequence."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import results_in
        from asdfviz.detector.device import require_device
        from asdfviz.synth.images import check_seed
        from asdfviz.synth.sequence_config import condition_config
        from asdfviz.synth.sequences import generate_sequence

        require_device(self.device)
        check_seed(self.seed)
        assembly = load_assembly(self.assembly)
        with (
            results_in(self.out),
            progress_bar("sequence") as report,
            stop_on_interrupt() as stop,
        ):
            written = generate_sequence(
                assembly,
                seed=self.seed,
                folder=self.out,
                config=condition_config(
                    self.condition,
                    width=self.width,
                    height=self.height,
                    frames=self.frames,
                    frames_per_state=self.frames_per_state,
                    fps=self.fps,
                    every=self.every,
                    error={"any": True, "none": False}.get(self.error, self.error),
                    unlisted=self.unlisted,
                    shift=self.shift,
                    photos=photos_in(self.grounds, self.ground_width),
                ),
                progress=with_rate(report, "frames"),
                stop=stop,
                device=self.device,
                masks=self.masks,
                exactly=True,
            )
            stopped = stop()
        if stopped:
            raise Stopped(f"{counted(written, 'frame')} in {self.out}; the same line goes on")
        print(self.out)


@dataclass(frozen=True)
class SynthTestset:
    """Write the sequences of the paper's Table 1 and of GBOT's four conditions.

    One of them comes a second time, drawn by a plain renderer. Their seeds are kept apart from
    those of training.

    Example: asdfviz synth testset --assembly corner_clamp --out testsets
    """

    assembly: str
    """assembly.yaml, its folder, or a bundled name."""
    out: Path
    """Receives <assembly>/<set>/; frames that are there already stay."""
    only: Literal["table1", "gbot"] | None = None
    """Make only these sequences."""
    seed: int = 0
    """Another number gives another test set of the same kind, 0 to 99999."""
    width: int = 1280
    """Image width, pixels."""
    height: int = 720
    """Image height, pixels."""
    frames_per_state: int | None = None
    """At least so many; states with long ways take more. Default: the paper's numbers of frames, 22 to
    24 a state."""
    masks: bool = False
    """Write BOP's mask/ and mask_visib/ too."""
    workers: int = 1
    """Processes that share the sequences."""
    joblib_backend: Literal["loky", "dask", "ray"] | None = None
    """Share the sequences by joblib's engine instead; dask and ray reach other machines."""
    device: str = "cpu"
    """Where torch renders: cpu or cuda."""

    def __call__(self) -> None:
        """Generate the sets."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import make_folder
        from asdfviz.detector.device import require_device
        from asdfviz.synth.testset import SetsConfig, generate_testset
        from asdfviz.synth.workers import Crew

        require_device(self.device)
        assembly = load_assembly(self.assembly)
        make_folder(self.out)
        with progress_bar("test set") as report, stop_on_interrupt() as stop:
            folder = generate_testset(
                assembly,
                folder=self.out,
                config=SetsConfig(
                    only=self.only,
                    seed=self.seed,
                    width=self.width,
                    height=self.height,
                    frames_per_state=self.frames_per_state,
                    masks=self.masks,
                ),
                command=shlex.join(["asdfviz", *sys.argv[1:]]),
                progress=with_rate(report, "frames"),
                stop=stop,
                device=self.device,
                crew=Crew(self.workers, self.joblib_backend),
            )
        if folder is None:
            raise Stopped(f"what is done is in {self.out}; the same line goes on")
        print(folder)


@dataclass(frozen=True)
class Synth:
    """Make synthetic data with exact truth for any assembly."""

    what: (
        Annotated[SynthPacks, tyro.conf.subcommand("packs")]
        | Annotated[SynthImages, tyro.conf.subcommand("images")]
        | Annotated[SynthSequence, tyro.conf.subcommand("sequence")]
        | Annotated[SynthTestset, tyro.conf.subcommand("testset")]
    )

    def __call__(self) -> None:
        """Make what was chosen."""
        self.what()
