"""`asdfviz evaluate`: runs against truth."""

from __future__ import annotations

import json
import shutil
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from asdfviz.cli.progress import progress_bar


@dataclass(frozen=True)
class Evaluate:
    """Judge runs against truth, and print a table. Runs of one method on one sequence are called by
    their folders, too.

    In a pipe or to a file all figures go as JSON, and the table to stderr; --json prints them alone.

    Example: asdfviz evaluate runs/asdf runs/mine --format latex

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
    """Means over the runs too, plain and weighted by frames; in JSON {"runs": [...], "means": [...]}."""
    json: bool = False
    """JSON on stdout and no table: one object, or a list for several runs."""
    format: Literal["md", "csv", "latex"] | None = None
    """Print the runs (with --summary in csv and latex: their means) as one table of this form, and no
    JSON; all figures, in latex those that are defined."""

    def __call__(self) -> None:
        """Judge, and print."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.errors import InputError
        from asdfviz.evaluate.evaluate import evaluate_result
        from asdfviz.evaluate.inputs import open_result, refuse_csv_options, run_names

        if not self.runs:
            raise InputError("name at least one run folder, as in: asdfviz evaluate runs/asdf")
        if self.json and self.format is not None:
            raise InputError(f"--json and --format {self.format} are two outputs: leave one out")
        refuse_csv_options(self.runs, sequence=self.sequence, scene=self.scene)
        assembly = load_assembly(self.assembly) if self.assembly else None
        opened = [
            open_result(
                folder,
                truth_folder=self.truth,
                assembly=assembly,
                sequence=self.sequence,
                scene=self.scene,
            )
            for folder in self.runs
        ]
        names = run_names([(one.source, one.run) for one in opened])
        results: list[dict[str, Any]] = []
        with progress_bar("evaluate") as progress:
            for one, name in zip(opened, names, strict=True):
                if not self.json:
                    progress(len(results), len(self.runs), one.source.name)
                named = replace(one, run=replace(one.run, method=name))
                report = evaluate_result(named, protocol=self.protocol, truth_folder=self.truth)
                results.append(report)
            if not self.json:
                progress(len(results), len(self.runs), "")
        self._print(results)

    def _print(self, results: list[dict[str, Any]]) -> None:
        from asdfviz.evaluate.summary import summaries

        means = summaries(results) if self.summary else []
        if self.format is not None:
            print(_table(results, means, self.format))
            for result in results if self.format != "md" else []:
                for warning in result.get("warnings", ()):
                    print(f"warning: {result['method']}: {warning}", file=sys.stderr)
            return
        is_read = sys.stdout.isatty() and not self.json
        if not self.json:
            print(_told(results, means), file=sys.stdout if is_read else sys.stderr)
        if not is_read:
            said = {"runs": results, "means": means} if self.summary else results
            single = len(results) == 1 and not self.summary
            print(json.dumps(results[0] if single else said, indent=2, allow_nan=False))


def _told(results: list[dict[str, Any]], means: list[dict[str, Any]]) -> str:
    """What a person reads: as wide as the terminal, 100 characters where there is none."""
    from asdfviz.evaluate.terminal_table import means_summary, runs_summary

    width = shutil.get_terminal_size((100, 24)).columns
    told = [means_summary(means, width=width)] if means else []
    return "\n\n".join([*told, runs_summary(results, width=width)])


def _table(results: list[dict[str, Any]], means: list[dict[str, Any]], form: str) -> str:
    """One table, for a text or another program."""
    from asdfviz.evaluate.tables import markdown_table, means_in, means_table, runs_in

    if form == "md":
        return "\n\n".join([markdown_table(results), *([means_table(means)] if means else [])])
    layout = "csv" if form == "csv" else "latex"
    return means_in(layout, means) if means else runs_in(layout, results)


@dataclass(frozen=True)
class Agree:
    """Compare a run's poses with the depth that the camera measured: needs no truth. JSON on stdout.

    Example: asdfviz agree runs/my_capture --pictures agreement
    """

    run: Annotated[Path, tyro.conf.Positional]
    """Folder that `asdfviz run` wrote."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name. Default: the one that the run used."""
    register: bool = True
    """Move depth onto colour first where their edges say that it lies beside."""
    pictures: Path | None = None
    """Receives the frames that agree least: red where the camera saw deeper than the part, blue where
    nearer."""
    count: int = 6
    """So many of them."""
    json: bool = False
    """JSON only, no table."""

    def __call__(self) -> None:
        """Print the figures of every part, and write the pictures."""
        from asdfviz.cli.progress import progress_bar, stop_on_interrupt
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import make_folder, write_bytes
        from asdfviz.data.encoding import encoded
        from asdfviz.data.run_files import check_fits, check_run_folder, load_run
        from asdfviz.data.sequences import open_sequence
        from asdfviz.errors import InputError
        from asdfviz.evaluate.agreement import FrameAgreement, agreement, agreement_table
        from asdfviz.evaluate.inputs import assembly_of

        if self.count < 1:
            raise InputError(f"--count is {self.count}, use 1 or more")
        run = load_run(self.run)
        assembly = load_assembly(self.assembly) if self.assembly else assembly_of(run, self.run)
        check_fits(run.predictions, assembly, self.run)
        sequence = open_sequence(run.sequence, assembly=assembly)
        if self.pictures is not None:
            check_run_folder(self.pictures, Path(run.sequence))
            make_folder(self.pictures)
        worst: list[FrameAgreement] = []

        def keep(frame: FrameAgreement) -> None:
            worst.append(frame)
            worst.sort(key=lambda one: -one.residual_mm)
            del worst[self.count :]

        with progress_bar(run.method) as report, stop_on_interrupt() as stop:
            found = agreement(
                run,
                sequence,
                assembly,
                register=self.register,
                seen=keep if self.pictures is not None else None,
                progress=lambda done, total: report(done, total, ""),
                stop=stop,
            )
        if self.pictures is not None:
            for frame in worst:
                file = self.pictures / f"{frame.frame_index:06d}.png"
                write_bytes(file, encoded(frame.picture[:, :, ::-1]))
        if not self.json:
            print(agreement_table(found), file=sys.stderr)
        print(json.dumps(found, indent=2, allow_nan=False))
