"""`asdfviz check`, `import-gbot` and `export`: what goes in and what comes out."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import tyro

from asdfviz.cli import BAD_INPUT
from asdfviz.cli.progress import progress_bar
from asdfviz.errors import InputError


@dataclass(frozen=True)
class Check:
    """Look a sequence over for wrong units, intrinsics, sizes, gaps and shifted depth.

    Example: asdfviz check sample

    Findings exit 0, images that cannot be read 2.
    """

    sequence: Annotated[str, tyro.conf.Positional]
    """Scene folder, or `sample`."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name."""
    format: str | None = None
    """folder, bop, gbot, asdf or asdf-rgbd. Default: recognised by content."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> int:
        """Print the findings; returns the exit code."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.sequences import open_sequence
        from asdfviz.evaluate.health import check_sequence

        assembly = load_assembly(self.assembly) if self.assembly else None
        sequence = open_sequence(self.sequence, assembly=assembly, format=self.format)
        with progress_bar("check") as progress:
            report = check_sequence(sequence, progress=progress)
        code = 0 if report.is_readable else BAD_INPUT
        if self.json:
            print(json.dumps(report.to_json(), indent=2, allow_nan=False))
            return code
        for finding in report.findings:
            print(f"{finding.severity:<8} {finding.message}")
        looked = f"looked at {report.frames_looked_at} of {report.frames} frames"
        print(looked if report.findings else f"nothing found, {looked}")
        return code


@dataclass(frozen=True)
class ImportGbot:
    """Turn the parts of the GBOT dataset into assemblies that every command takes.

    Example: asdfviz import-gbot GBOT_dataset --out my_models
    """

    source: Annotated[Path, tyro.conf.Positional]
    """Folder with assemblies.json and meshes, or the dataset as published."""
    out: Path
    """Folder that receives gbot_nanovise and the others."""

    def __call__(self) -> None:
        """Import and print one assembly.yaml a line."""
        from asdfviz.data.gbot_import import import_gbot

        for file in import_gbot(self.source, self.out):
            print(file)


@dataclass(frozen=True)
class Export:
    """Write corrected poses and states as a BOP scene with states.json, or as YOLO-pose labels.

    Example: asdfviz export sample --out exported
    """

    sequence: Annotated[str, tyro.conf.Positional]
    """Scene folder, or `sample`."""
    out: Path
    """A new folder."""
    annotations: Path | None = None
    """Folder of the corrections. Default: where the app keeps them."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name."""
    format: str | None = None
    """folder, bop, gbot, asdf or asdf-rgbd. Default: recognised by content."""
    layout: Literal["bop", "yolo", "yolo-depth"] = "bop"
    """What to write; yolo-depth has the ASDF authors' images with depth in the fourth channel."""
    ids: Literal["names", "numbers"] = "names"
    """What obj_id is in a BOP scene: the parts' names (GBOT) or their numbers (BOP's own tools)."""

    unchecked: bool = False
    """Also frames, and states, that nobody set, tracked or verified, as the run has them that
    corrections started from."""

    def __call__(self) -> None:
        """Export what the annotation holds."""
        from asdfviz.annotate.checked import annotated
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.sequences import open_sequence
        from asdfviz.export.bop import export_bop
        from asdfviz.export.gaps import told_gaps
        from asdfviz.export.readable import told_left_out
        from asdfviz.export.yolo import export_yolo

        if self.ids == "numbers" and self.layout != "bop":
            raise InputError(
                f"--ids numbers is for --layout bop; labels of {self.layout} number their classes anyway"
            )
        assembly = load_assembly(self.assembly) if self.assembly else None
        sequence = open_sequence(self.sequence, assembly=assembly, format=self.format)
        known = annotated(sequence, annotations=self.annotations, guesses=self.unchecked)
        with progress_bar("export") as report:
            export = (
                partial(export_bop, ids=self.ids)
                if self.layout == "bop"
                else partial(export_yolo, with_depth=self.layout == "yolo-depth")
            )
            left_out = export(
                sequence,
                known.truth,
                self.out,
                gone=known.gone,
                progress=lambda done, total: report(done, total, ""),
            )
        if left_out:
            print(f"warning: {told_left_out(left_out)}", file=sys.stderr)
        if known.unchecked:
            print(f"note: {known.unchecked} (--unchecked exports all)", file=sys.stderr)
        parts = () if sequence.assembly is None else tuple(sequence.assembly.parts)
        if gaps := told_gaps(known.truth, sequence.frame_indices, parts, gone=known.gone):
            print(f"note: {gaps}", file=sys.stderr)
        print(self.out)
