"""`asdfviz tables`: the paper's tables by one command, its figures beside ours."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from asdfviz.cli.progress import progress_bar, stop_on_interrupt
from asdfviz.errors import InputError, RunError, Stopped, WeightsError

if TYPE_CHECKING:
    from asdfviz.data.folder_sequence import FolderSequence
    from asdfviz.datatypes import Run
    from asdfviz.evaluate.paper_table5 import JudgedRun, Layout
    from asdfviz.methods.spec import MethodSpec

CONDITIONS = ("normal", "dynamic", "hand", "blur")
"""GBOT's sequences of each assembly, as `asdfviz synth testset` names them."""
LAYOUTS: dict[str, Layout] = {".md": "markdown", ".csv": "csv", ".tex": "latex"}


@dataclass(frozen=True)
class Tables:
    """Make a table of the paper, its figures beside ours.

    gbot is Table 5: all methods on GBOT-style test sets; runs that are there already are taken.

    Example: asdfviz tables gbot --data testsets --out table5.md
    """

    table: Annotated[Literal["gbot"], tyro.conf.Positional]
    """Which one."""
    data: Path
    """Folder with <assembly>/normal, dynamic, hand, blur, as `asdfviz synth testset` writes it."""
    methods: tuple[str, ...] = ()
    """Default: the paper's seven, and asdf_track."""
    out: Path | None = None
    """File for the table, .md, .csv or .tex. Default: Markdown on stdout."""
    models: Path | None = None
    """Folder with <assembly>/assembly.yaml. Default: what each sequence names."""
    again: bool = False
    """Run anew what was run before. Runs lie in each sequence's folder, runs/table5-<method>."""

    def __call__(self) -> None:
        """Run, judge by both protocols, and print or write the table."""
        from asdfviz.evaluate.paper_table5 import METHODS, table5
        from asdfviz.methods.registry import find_method

        suffix = ".md" if self.out is None else self.out.suffix
        if suffix not in LAYOUTS:
            raise InputError(f"{self.out}: name the table .md, .csv or .tex")
        specs = [find_method(name) for name in self.methods or METHODS]
        sequences = [self._open(folder) for folder in condition_folders(self.data)]
        if any(spec.name not in DETECT_ALONE for spec in specs):
            _make_viewpoint_models(sequences)
        judged: list[JudgedRun] = []
        for spec in specs:
            for sequence in sequences:
                try:
                    run = self._run(spec, sequence)
                except WeightsError as error:
                    print(f"{spec.name} is left out on {sequence.path}: {error}", file=sys.stderr)
                    continue
                judged.append(_judged(run, sequence))
        self._give(table5(judged, layout=LAYOUTS[suffix]))

    def _give(self, table: str) -> None:
        """Write or print it, and what its columns are."""
        from asdfviz.data.atomic import write_text

        if self.out is None:
            print(table)
        else:
            write_text(self.out, table + "\n")
            print(self.out)
        print(NOTE, file=sys.stderr)

    def _open(self, folder: Path) -> FolderSequence:
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.sequences import open_sequence

        known = None if self.models is None else load_assembly(self.models / folder.parent.name)
        return open_sequence(folder, assembly=known)

    def _run(self, spec: MethodSpec, sequence: FolderSequence) -> Run:
        """The run of a method that lies beside the sequence, made if need be."""
        from asdfviz.data.run_files import load_run, save_run
        from asdfviz.run import input_hashes, run

        config = as_published(spec)
        folder = Path(sequence.path) / "runs" / f"table5-{spec.name}"
        if not self.again and sequence.assembly is not None:
            try:
                kept = load_run(folder)
            except RunError:
                kept = None  # none, or one that cannot be read: it is made anew
            hashes = input_hashes(sequence, sequence.assembly, config)
            if kept and kept.hashes == hashes and len(kept.predictions) == len(sequence):
                return kept
        title = f"{spec.name} {sequence.path}"
        with progress_bar(title) as report, stop_on_interrupt() as stop:
            result = run(
                spec,
                sequence,
                config=config,
                progress=lambda done, total, _: report(done, total, ""),
                stop=stop,
            )
        if len(result.predictions) < len(sequence):
            raise Stopped("runs that were finished are kept for the next time")
        save_run(result, folder)
        return result


NOTE = (
    "paper: the ASDF paper's own figures, on its own sequences. gbot: ours by its rules, where a "
    "missing pose costs nothing. strict: a missing pose is a miss. Methods whose start is 'truth' "
    "were handed the true poses of the first frame, as in the paper, and are not judged on it; "
    "those trackers give the poses of lost parts too, as published."
)


def condition_folders(data: Path) -> list[Path]:
    """The sequences of all assemblies, by name.

    Raises:
        InputError: there are none.
    """
    found = [
        assembly / name
        for assembly in sorted(p for p in data.glob("*") if p.is_dir())
        for name in CONDITIONS
        if (assembly / name / "rgb").is_dir()
    ]
    if not found:
        raise InputError(
            f"{data} holds no test sets (<assembly>/{'|'.join(CONDITIONS)}): make them with "
            f"`asdfviz synth testset --assembly NAME --out {data}`"
        )
    return found


DETECT_ALONE = ("yolov8pose", "asdf")
"""Methods that need no viewpoint models."""


def _make_viewpoint_models(sequences: list[FolderSequence]) -> None:
    """Make what the trackers need before they run: once a part, with progress."""
    from asdfviz.track.viewpoint_cache import load_viewpoint_models

    assemblies = {s.assembly.path: s.assembly for s in sequences if s.assembly is not None}
    for assembly in assemblies.values():
        title = f"views of {assembly.name}"
        with progress_bar(title) as report, stop_on_interrupt() as stop:
            load_viewpoint_models(
                assembly, progress=lambda done, total: report(done, total, ""), stop=stop
            )


def as_published(spec: MethodSpec) -> object:
    """A method's config as its paper has it: trackers that know no loss say all their poses."""
    config: Any = spec.config()
    if hasattr(config, "report_lost"):
        return dataclasses.replace(config, report_lost=True)
    return config


def _judged(run: Run, sequence: FolderSequence) -> JudgedRun:
    from asdfviz.data.truth import read_truth
    from asdfviz.evaluate.evaluate import judge, protocol_report
    from asdfviz.evaluate.paper_table5 import JudgedRun

    assembly = sequence.assembly
    if assembly is None:
        raise InputError(f"{sequence.path} does not name its assembly: give --models")
    truth = read_truth(Path(sequence.path), assembly)
    found = judge(run, assembly=assembly, truth=truth, camera=sequence.camera)
    name = f"{assembly.name}/{Path(sequence.path).name}"
    return JudgedRun(
        run.method,
        name,
        run.initial,
        protocol_report(found, protocol="gbot"),
        protocol_report(found, protocol="strict"),
    )
