"""`asdfviz bench`: speed and accuracy against references, as ratios in one run."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from asdfviz.cli.progress import progress_bar


@dataclass(frozen=True)
class BenchTrack:
    """Run every tracker mode on a folder with a reference tracker's results beside it.

    Example: asdfviz bench track tracker_jaw640
    """

    folder: Annotated[Path, tyro.conf.Positional]
    """Folder with color, depth, gt.txt, init.txt, mesh.obj, meta.json and m3t_* results."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> None:
        """Print accuracy and time, mode by mode, ours beside the reference's."""
        from asdfviz.bench.track import bench_table, json_report, measure

        results = measure(self.folder)
        print(json.dumps(json_report(results), indent=2) if self.json else bench_table(results))


@dataclass(frozen=True)
class BenchSynth:
    """Time the generator of training images in one process.

    Example: asdfviz bench synth --assembly corner_clamp
    """

    assembly: str = "corner_clamp"
    """assembly.yaml, its folder, or a bundled name."""
    images: int = 10
    """Timed images of each kind and size."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> None:
        """Print images a second by kind and size, and the machine's load."""
        from asdfviz.bench.synth import measure_synth, speed_table
        from asdfviz.data.assembly import load_assembly

        with progress_bar("bench synth") as report:
            speeds = measure_synth(
                load_assembly(self.assembly),
                images=self.images,
                progress=lambda done, total: report(done, total, ""),
            )
        print(json.dumps([vars(s) for s in speeds], indent=2) if self.json else speed_table(speeds))


@dataclass(frozen=True)
class Bench:
    """Measure speed; figures are ratios within one run, the machine's load is printed."""

    what: (
        Annotated[BenchTrack, tyro.conf.subcommand("track")]
        | Annotated[BenchSynth, tyro.conf.subcommand("synth")]
    )

    def __call__(self) -> None:
        """Run the chosen benchmark."""
        self.what()
