"""What the workspace holds: loaded runs, poses to draw, background work and what there is to tell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from asdfviz.app import theme
from asdfviz.datatypes import FramePrediction, Run, Stage
from asdfviz.geometry.shapes import Transform

ANNOTATION = "annotation"
"""The source of what was corrected."""
PROGRAM_FAULT = "a fault in the program, which the terminal tells"
"""What is told of an error that nobody foresaw."""


@dataclass(frozen=True, slots=True, eq=False)
class LoadedRun:
    """A run on this sequence, by place."""

    id: str
    label: str
    color: theme.Rgb3
    run: Run
    by_place: tuple[FramePrediction | None, ...]
    folder: Path | None = None
    """None while it is still being computed."""
    home: Path | None = None
    """The folder that it is or will be saved in."""

    @property
    def milliseconds(self) -> float | None:
        """Median time of a frame."""
        totals = [p.runtime["total"] for p in self.run.predictions if "total" in p.runtime]
        return 1000 * float(np.median(totals)) if totals else None


@dataclass(frozen=True, slots=True, eq=False)
class Shown:
    """The pose that a part is drawn at, and where it is from."""

    T_camera_part: Transform
    source: str
    """ANNOTATION or a run's id."""
    stage: Stage
    score: float | None = None


@dataclass(frozen=True, slots=True)
class JobStatus:
    """A method at work, or how it ended."""

    method: str
    state: Literal["running", "stopping", "done", "stopped", "failed"]
    done: int = 0
    total: int = 0
    milliseconds: float | None = None
    message: str = ""
    part: str = ""
    """Of tracking: the part that was selected."""
    lost: tuple[int, ...] = ()
    """Of tracking: the places at which that part was not found."""
    version: int = 0
    """Of the annotation once it had ended: later it may no longer be as was told."""
    told: str = ""
    """Of tracking and fitting: what is being done, then what came of it, in words."""
    unsure: bool = False
    """Of fitting: `told` says why a person should look."""
    preparing: bool = False
    """`done` and `total` count views of the parts that the method needs made first, not frames."""

    @property
    def is_active(self) -> bool:
        """Whether it still works."""
        return self.state in ("running", "stopping")


@dataclass(frozen=True, slots=True)
class Message:
    """Something to tell."""

    title: str
    body: str
    is_problem: bool = False
