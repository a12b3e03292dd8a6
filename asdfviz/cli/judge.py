"""`asdfviz evaluate`: runs against truth."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class Evaluate:
    """Judge runs against truth. JSON on stdout, a table on stderr.

    Example: asdfviz evaluate runs/asdf --protocol strict --json

    Results made elsewhere are judged alike, as in
    asdfviz evaluate results.csv --sequence my_scene --assembly my_model
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders that `asdfviz run` wrote, or csv files of BOP or GBOT."""
    protocol: Literal["strict", "gbot", "bop"] = "strict"
    """strict: a missing pose is a miss; figures that end in _twins let a pose lie on any of several
    identical parts. gbot: the rules of the authors' own script. bop: strict, and the average recalls
    of the BOP challenge (VSD, MSSD, MSPD; renders, so it takes longer), identical parts as instances
    of one object."""
    truth: Path | None = None
    """Folder with scene_gt.json and states.json. Default: the run's own sequence."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name. Default: the one that the run used."""
    sequence: str | None = None
    """The scene folder, or `sample`, that a csv is about."""
    scene: str | None = None
    """Whose rows of a csv to take. Default: those of the sequence's folder, or the only ones."""
    summary: bool = False
    """Print {"runs": [...], "means": [...]}: means over the runs, plain and weighted by frames."""
    json: bool = False
    """JSON only, no table."""

    def __call__(self) -> None:
        """Print one object, or a list for several runs."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.errors import InputError
        from asdfviz.evaluate.evaluate import evaluate_folder
        from asdfviz.evaluate.summary import summaries
        from asdfviz.evaluate.tables import markdown_table, means_table

        if not self.runs:
            raise InputError("name at least one run folder, as in: asdfviz evaluate runs/asdf")
        assembly = load_assembly(self.assembly) if self.assembly else None
        results = [
            evaluate_folder(
                folder,
                protocol=self.protocol,
                truth_folder=self.truth,
                assembly=assembly,
                sequence=self.sequence,
                scene=self.scene,
            )
            for folder in self.runs
        ]
        means = summaries(results) if self.summary else []
        if not self.json:
            print(markdown_table(results), file=sys.stderr)
        if not self.json and means:
            print(f"\n{means_table(means)}", file=sys.stderr)
        said = {"runs": results, "means": means} if self.summary else results
        single = len(results) == 1 and not self.summary
        print(json.dumps(results[0] if single else said, indent=2, allow_nan=False))
