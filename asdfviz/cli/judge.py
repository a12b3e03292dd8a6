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
    """Judge saved runs against truth. JSON on stdout, a table on stderr.

    Example: asdfviz evaluate runs/asdf --protocol strict --json
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders that `asdfviz run` wrote."""
    protocol: Literal["strict", "gbot"] = "strict"
    """strict: a missing pose is a miss. gbot: the rules of the authors' own script."""
    truth: Path | None = None
    """Folder with scene_gt.json and states.json. Default: the run's own sequence."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name. Default: the one that the run used."""
    json: bool = False
    """JSON only, no table."""

    def __call__(self) -> None:
        """Print one object, or a list for several runs."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.errors import InputError
        from asdfviz.evaluate.evaluate import evaluate_folder
        from asdfviz.evaluate.tables import markdown_table

        if not self.runs:
            raise InputError("name at least one run folder, as in: asdfviz evaluate runs/asdf")
        assembly = load_assembly(self.assembly) if self.assembly else None
        results = [
            evaluate_folder(
                folder, protocol=self.protocol, truth_folder=self.truth, assembly=assembly
            )
            for folder in self.runs
        ]
        if not self.json:
            print(markdown_table(results), file=sys.stderr)
        print(json.dumps(results[0] if len(results) == 1 else results, indent=2, allow_nan=False))
