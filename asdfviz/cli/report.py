"""`asdfviz report`: judged runs as one page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from asdfviz.cli.progress import progress_bar


@dataclass(frozen=True)
class Report:
    """Write runs beside the truth as one self-contained page: tables, curves, states, worst frames.

    Example: asdfviz report runs/asdf runs/yolov8pose --out report.html
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders that `asdfviz run` wrote, or csv files of BOP or GBOT."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("report.html")
    """The page."""
    truth: Path | None = None
    """Folder with scene_gt.json and states.json. Default: each run's own sequence."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name. Default: the one that each run used."""
    sequence: str | None = None
    """The scene folder, or `sample`, that a csv is about."""
    scene: str | None = None
    """Whose rows of a csv to take. Default: those of the sequence's folder, or the only ones."""
    pictures: int = 4
    """Worst frames shown of each run; 0 draws none."""

    def __call__(self) -> None:
        """Write the page and print its name."""
        from asdfviz.evaluate.report import write_report

        with progress_bar("report") as progress:
            write_report(
                self.runs,
                self.out,
                truth_folder=self.truth,
                assembly=self.assembly,
                sequence=self.sequence,
                scene=self.scene,
                pictures=self.pictures,
                progress=progress,
            )
        print(self.out)
