"""`asdfviz run` and `asdfviz methods`."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, TypeAlias, cast

import tyro

from asdfviz.cli.progress import progress_bar, stop_on_interrupt
from asdfviz.datatypes import FramePrediction, Run, Sequence
from asdfviz.errors import AsdfvizError, InputError, RunError, Stopped
from asdfviz.methods.spec import MethodSpec

Chosen: TypeAlias = tuple[MethodSpec, object]
"""A method and its config."""


@dataclass(frozen=True)
class RunMethod:
    """Run a method on a sequence and save what it says.

    Example: asdfviz run --method asdf sample --out runs/asdf

    Options of the method itself stand in the same line, as in
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
    first: int | None = None
    """Only so many frames, from the first on."""

    def __call__(self, chosen: Chosen | None = None) -> None:
        """Run, save, and say where; without a method at hand, by its name with its defaults."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import results_in
        from asdfviz.data.run_files import check_run_folder
        from asdfviz.data.sequences import open_sequence
        from asdfviz.methods.registry import find_method
        from asdfviz.run import frames_wanted, run

        spec, config = chosen or (find_method(self.method), None)
        assembly = load_assembly(self.assembly) if self.assembly else None
        sequence = open_sequence(self.sequence, assembly=assembly, format=self.format)
        out = self.out or _own_folder(Path("runs") / f"{sequence.name}-{spec.name}", sequence)
        check_run_folder(out, Path(sequence.path))
        kept: list[Run] = []
        with results_in(out):
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
                        first=self.first,
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
        if len(result.predictions) < frames_wanted(sequence, self.first):
            raise Stopped(saved)


OWN_OPTIONS = (
    "-m",
    *(f"--{field.name}" for field in fields(RunMethod) if field.name != "sequence"),
)
"""Of `asdfviz run` itself, each with a value; all others are the method's."""


def _own_folder(folder: Path, sequence: Sequence) -> Path:
    """The folder, or one with a number behind its name where it holds a run on another recording."""
    from asdfviz.data.run_files import scene_of_run

    scene = str(Path(sequence.path).resolve())
    for number in itertools.count(1):
        own = folder if number == 1 else folder.with_name(f"{folder.name}-{number}")
        try:
            if scene_of_run(own) == scene:
                return own
        except RunError:
            return own  # none, or none that anyone could read
    raise AssertionError("unreachable: count() does not end")


def _saved(run: Run, sequence: Sequence, out: Path) -> tuple[Path, str]:
    """Save a run; a part never replaces more than it has. Returns where, and what there is to say."""
    from asdfviz.data.run_files import load_run, save_run

    def held(folder: Path) -> int:
        try:
            return len(load_run(folder).predictions)
        except RunError:
            return 0  # none, or none that anyone could read

    names = (f"{out.name}-partial{'' if n == 1 else f'-{n}'}" for n in itertools.count(1))
    while len(run.predictions) < min(held(out), len(sequence)):
        out = out.with_name(next(names))
    save_run(run, out)
    return out, f"{len(run.predictions)} of {len(sequence)} frames are saved in {out}"


def method_config(spec: MethodSpec, arguments: list[str]) -> object:
    """Read a method's own options; `--help` among them prints them and exits."""
    return tyro.cli(cast(type[object], spec.config), args=arguments, prog=_prog(spec))


def method_apart(arguments: list[str]) -> tuple[list[str], Chosen | None]:
    """Part a line of `run` into its own arguments and the method with the config that it asks for.

    Options may stand in any order. Only the method knows which of its own take a value, so it reads
    them first, and what it leaves is the sequence.

    Args:
        arguments: the line from `run` on.

    Returns:
        The line without the method's options, and the method; None where the line names none.

    Raises:
        InputError: there is no such method.
    """
    from asdfviz.methods.registry import find_method

    own, others = _own_options(arguments[1:])
    name = _named_method(own)
    if name is None:
        return arguments, None
    spec = find_method(name)
    config, unknown = tyro.cli(
        cast(type[object], spec.config),
        args=others,
        prog=_prog(spec),
        return_unknown_args=True,
    )
    place = next((i for i, word in enumerate(unknown) if not word.startswith("-")), len(unknown))
    surplus = unknown[:place] + unknown[place + 1 :]
    if surplus:
        method_config(spec, surplus)  # exits, and says which options there are
    return [arguments[0], *own, *unknown], (spec, config)


def print_method_help(arguments: list[str]) -> None:
    """Print the options of the method that the line names, if it names one."""
    from asdfviz.methods.registry import find_method

    name = _named_method(_own_options(arguments[1:])[0])
    if name is not None:
        method_config(find_method(name), ["--help"])


def _own_options(arguments: list[str]) -> tuple[list[str], list[str]]:
    """The options of `run` itself with their values, and everything else."""
    own: list[str] = []
    others: list[str] = []
    words = iter(arguments)
    for word in words:
        if word in OWN_OPTIONS:
            own += [word, *([value] if (value := next(words, None)) is not None else [])]
        elif word.partition("=")[0] in OWN_OPTIONS:
            own.append(word)
        else:
            others.append(word)
    return own, others


def _named_method(own: list[str]) -> str | None:
    """The value of the last --method."""
    name = None
    for place, word in enumerate(own):
        flag, has_value, value = word.partition("=")
        if flag in ("--method", "-m"):
            name = value if has_value else next(iter(own[place + 1 :]), None)
    return name


def _prog(spec: MethodSpec) -> str:
    return f"asdfviz run --method {spec.name}"


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
