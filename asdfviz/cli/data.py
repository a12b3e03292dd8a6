"""`asdfviz check`, `import-gbot` and `export`: what goes in and what comes out."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from asdfviz.cli import BAD_INPUT
from asdfviz.cli.progress import progress_bar
from asdfviz.errors import InputError

if TYPE_CHECKING:
    from asdfviz.evaluate.health_report import AssemblyReport, HealthReport


@dataclass(frozen=True)
class Check:
    """Look a sequence over for wrong units, intrinsics, sizes, gaps and shifted depth; or an assembly
    for units, parts that overlap or float, states that are alike, and symmetries left out.

    Example: asdfviz check sample
    Example: asdfviz check my_model/assembly.yaml

    Findings exit 0, images that cannot be read 2.
    """

    sequence: Annotated[str, tyro.conf.Positional]
    """Scene folder, or `sample`; or an assembly.yaml, its folder, or a bundled name."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name."""
    format: str | None = None
    """folder, bop, gbot, asdf or asdf-rgbd. Default: recognised by content."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> int:
        """Print the findings; returns the exit code."""
        if self.assembly is None and self.format is None and _is_assembly(self.sequence):
            return self._check_assembly()
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.sequences import open_sequence
        from asdfviz.evaluate.health import check_sequence

        assembly = load_assembly(self.assembly) if self.assembly else None
        sequence = open_sequence(self.sequence, assembly=assembly, format=self.format)
        with progress_bar("check") as progress:
            report = check_sequence(sequence, progress=progress)
        self._print(report, f"looked at {report.frames_looked_at} of {report.frames} frames")
        return 0 if report.is_readable else BAD_INPUT

    def _check_assembly(self) -> int:
        from asdfviz.data.assembly import load_assembly
        from asdfviz.evaluate.health_assembly import check_assembly_alone

        with progress_bar("check") as progress:
            report = check_assembly_alone(load_assembly(self.sequence), progress=progress)
        self._print(report, f"looked at {report.parts} parts in {report.states} states")
        return 0

    def _print(self, report: HealthReport | AssemblyReport, looked: str) -> None:
        if self.json:
            print(json.dumps(report.to_json(), indent=2, allow_nan=False))
            return
        for finding in report.findings:
            print(f"{finding.severity:<8} {finding.message}")
        print(looked if report.findings else f"nothing found, {looked}")


def _is_assembly(name: str) -> bool:
    """Whether an assembly is meant: no scene folder, but an assembly's file, its folder or its name."""
    from asdfviz.data.resources import bundled_assemblies

    path = Path(name).expanduser()
    if (path / "rgb").is_dir():
        return False
    return (
        path.suffix == ".yaml" or (path / "assembly.yaml").is_file() or name in bundled_assemblies()
    )


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
    """Also poses that nobody set, tracked or verified, and states that nobody set, as the run has
    them that corrections started from; in labels also frames in which nobody said of all parts whether
    they are there: those without a pose are background then."""

    def __call__(self) -> None:
        """Export what the annotation holds."""
        from asdfviz.annotate.checked import annotated
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.sequences import open_sequence
        from asdfviz.export.bop import export_bop
        from asdfviz.export.gaps import told_gaps, told_label_gaps
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
            with_depth = self.layout == "yolo-depth"
            export, told = (
                (partial(export_bop, ids=self.ids), told_gaps)
                if self.layout == "bop"
                else (
                    partial(export_yolo, with_depth=with_depth, unchecked=self.unchecked),
                    partial(told_label_gaps, unchecked=self.unchecked),
                )
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
        if gaps := told(known.truth, sequence.frame_indices, parts, gone=known.gone):
            print(f"note: {gaps}", file=sys.stderr)
        print(self.out)
