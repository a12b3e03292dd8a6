"""`asdfviz run` and `asdfviz methods`."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, cast

import tyro

from asdfviz.cli.progress import progress_bar, stop_on_interrupt
from asdfviz.datatypes import FramePrediction, Run, Sequence
from asdfviz.errors import AsdfvizError, InputError, RunError, Stopped
from asdfviz.methods.spec import MethodSpec


@dataclass(frozen=True)
class RunMethod:
    """Run a method on a sequence and save what it says.

    Example: asdfviz run --method asdf sample --out runs/asdf

    Options of the method itself follow in the same line, as in
    asdfviz run --method asdf sample --out runs/asdf --detector.confidence 0.3
    """

    sequence: Annotated[str, tyro.conf.Positional]
    """Scene folder, or `sample` for the bundled one."""
    method: Annotated[str, tyro.conf.arg(aliases=["-m"])]
    """A name that `asdfviz methods` lists, or file.py:SPEC."""
    out: Path | None = None
    """Folder for the result. Default: runs/<sequence>-<method>."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name. Default: what the sequence names."""
    format: str | None = None
    """folder, bop, gbot, asdf or asdf-rgbd. Default: recognised by content."""

    def __call__(self, method_arguments: list[str]) -> None:
        """Run, save, and say where."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import make_folder
        from asdfviz.data.run_files import check_run_folder
        from asdfviz.data.sequences import open_sequence
        from asdfviz.methods.registry import find_method
        from asdfviz.run import run

        spec = find_method(self.method)
        config = method_config(spec, method_arguments)
        assembly = load_assembly(self.assembly) if self.assembly else None
        sequence = open_sequence(self.sequence, assembly=assembly, format=self.format)
        out = self.out or Path("runs") / f"{sequence.name}-{spec.name}"
        check_run_folder(out, Path(sequence.path))
        make_folder(out)
        kept: list[Run] = []
        try:
            with progress_bar(spec.name) as report, stop_on_interrupt() as stop:

                def show(done: int, total: int, prediction: FramePrediction) -> None:
                    total_ms = 1e3 * prediction.runtime.get("total", 0.0)
                    report(done, total, f"{total_ms:.0f} ms a frame")

                result = run(
                    spec,
                    sequence,
                    config=config,
                    progress=show,
                    stop=stop,
                    keep=kept.append,
                    prepare=lambda done, total: report(done, total, "views of the parts, once"),
                )
        except (AsdfvizError, OSError, KeyboardInterrupt) as error:
            if not kept:
                raise
            _, saved = _saved(kept[0], sequence, out)
            if isinstance(error, KeyboardInterrupt):
                raise Stopped(saved) from error
            raise InputError(f"{error}; {saved}") from error
        if not result.predictions:
            raise Stopped("no frame was done, nothing is saved")
        folder, saved = _saved(result, sequence, out)
        print(folder)
        if len(result.predictions) < len(sequence):
            raise Stopped(saved)


def _saved(run: Run, sequence: Sequence, out: Path) -> tuple[Path, str]:
    """Save a run; a part never replaces more than it has. Returns where, and what there is to say."""
    from asdfviz.data.run_files import load_run, save_run

    if len(run.predictions) < len(sequence):
        try:
            before = len(load_run(out).predictions)
        except RunError:
            before = 0  # none, or none that anyone could read
        if len(run.predictions) < min(before, len(sequence)):
            out = out.with_name(f"{out.name}-partial")
    save_run(run, out)
    return out, f"{len(run.predictions)} of {len(sequence)} frames are saved in {out}"


def method_config(spec: MethodSpec, arguments: list[str]) -> object:
    """Read a method's own options; `--help` among them prints them and exits."""
    return tyro.cli(
        cast(type[object], spec.config), args=arguments, prog=f"asdfviz run --method {spec.name}"
    )


def print_method_help(arguments: list[str]) -> None:
    """Print the options of the method that the line names, if it names one."""
    from asdfviz.methods.registry import find_method

    named = [value for flag, value in pairwise(arguments) if flag in ("--method", "-m")]
    if named:
        method_config(find_method(named[-1]), ["--help"])


@dataclass(frozen=True)
class Methods:
    """List the methods, built in and plugged in.

    Example: asdfviz methods
    """

    json: bool = False
    """Print JSON."""

    def __call__(self) -> None:
        """Print one line a method; a broken plug-in is listed with its reason."""
        from asdfviz.methods.registry import available_methods

        rows: list[dict[str, object]] = []
        for name, spec in available_methods().items():
            if isinstance(spec, MethodSpec):
                rows.append(
                    {
                        "name": name,
                        "summary": spec.summary,
                        "initial": spec.initial,
                        "predicts": sorted(spec.predicts),
                    }
                )
            else:
                rows.append({"name": name, "broken": spec.reason})
        if self.json:
            print(json.dumps(rows, indent=2))
            return
        for row in rows:
            print(f"{row['name']:<16} {row.get('summary') or 'broken: ' + str(row['broken'])}")
