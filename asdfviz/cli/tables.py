"""`asdfviz tables`: the paper's tables by one command, its figures beside ours."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from asdfviz.cli.given_runs import given_runs
from asdfviz.cli.judged_runs import (
    MadeRun,
    give_table,
    judged,
    kept_run,
    known_assembly,
    known_truth,
    layout_for,
    made_run,
)
from asdfviz.errors import InputError, WeightsError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from asdfviz.data.folder_sequence import FolderSequence
    from asdfviz.datatypes import Run
    from asdfviz.evaluate.judgement import Judgement
    from asdfviz.evaluate.paper_layout import Layout
    from asdfviz.evaluate.paper_table1 import SetFacts
    from asdfviz.evaluate.paper_table4 import JudgedSet
    from asdfviz.evaluate.paper_table5 import JudgedRun
    from asdfviz.methods.spec import MethodSpec

CONDITIONS = ("normal", "dynamic", "hand", "blur")
"""GBOT's sequences of each assembly, as `asdfviz synth testset` names them."""
TABLE1 = ("table1",)
"""The paper's own test set of each assembly, likewise."""


@dataclass(frozen=True)
class Tables:
    """Make a table of the paper, its figures beside ours.

    table1 lists the test sets. table4 is methods on the sets of Table 1, gbot is Table 5: all methods
    on GBOT-style test sets. What starts from a detector has a row with first poses from keypoints and,
    where crop weights are, one with hypotheses. Runs that this version made there already are taken; results of a method of
    your own are further rows, as in asdfviz tables gbot --data testsets --runs mine.csv

    Example: asdfviz tables gbot --data testsets --out table5.md
    """

    table: Annotated[Literal["table1", "table4", "gbot"], tyro.conf.Positional]
    """Which one."""
    data: Path
    """Folder with <assembly>/table1, normal, dynamic, ..., as `asdfviz synth testset` writes it."""
    methods: tuple[str, ...] = ()
    """Default: the paper's, and our own."""
    runs: tuple[Path, ...] = ()
    """Folders that `asdfviz run` wrote, or csv files of BOP or GBOT, for further rows. A csv calls the
    scenes as in vise/hand (or just hand, where one assembly has it), or lies in the scene's folder."""
    out: Path | None = None
    """File for the table, .md, .csv or .tex. Default: Markdown on stdout."""
    models: Path | None = None
    """Folder with <assembly>/assembly.yaml. Default: what each sequence names."""
    again: bool = False
    """Run anew what was run before. Runs lie in each sequence's folder, runs/<table>-<method>."""

    def __call__(self) -> None:
        """Run, judge by both protocols, and print or write the table."""
        layout = layout_for(self.out)
        if self.runs and self.table == "table1":
            raise InputError("table1 lists test sets and no methods: leave out --runs")
        if self.table == "table1":
            give_table(self._table1(layout), NOTE_TABLE1, self.out)
        elif self.table == "table4":
            give_table(self._table4(layout), NOTE_TABLE4, self.out)
        else:
            give_table(self._table5(layout), NOTE, self.out)

    def _table1(self, layout: Layout) -> str:
        from asdfviz.evaluate.paper_table1 import table1

        folders = condition_folders(self.data, names=(*TABLE1, *CONDITIONS))
        return table1([set_facts(self._open(folder)) for folder in folders], layout=layout)

    def _table4(self, layout: Layout) -> str:
        from asdfviz.evaluate.paper_table4 import METHODS, table4
        from asdfviz.methods.registry import find_method

        specs = [find_method(name) for name in self.methods or METHODS]
        sequences = [self._open(f) for f in condition_folders(self.data, names=TABLE1)]
        given = given_runs(self.runs, sequences, taken=[spec.name for spec in specs])
        sets = [
            judged_set(judged(one.run, one.sequence, option="--models"), one.first_pose)
            for one in self._runs(specs, sequences)
        ]
        sets += [judged_set(one.found, one.run.config.get("first_pose")) for one in given]
        return table4(sets, layout=layout)

    def _table5(self, layout: Layout) -> str:
        from asdfviz.evaluate.paper_table5 import METHODS, table5
        from asdfviz.methods.registry import find_method

        specs = [find_method(name) for name in self.methods or METHODS]
        sequences = [self._open(f) for f in condition_folders(self.data, names=CONDITIONS)]
        given = given_runs(self.runs, sequences, taken=[spec.name for spec in specs])
        runs: list[JudgedRun] = []
        for one in self._runs(specs, sequences):
            found = judged(one.run, one.sequence, option="--models")
            told = without_lost(one.run, one.config)
            kept = found if told is one.run else judged(told, one.sequence, option="--models")
            runs.append(judged_run(found, kept, one.first_pose, one.sequence))
        for one in given:
            kind = one.run.config.get("first_pose")
            runs.append(judged_run(one.found, one.found, kind, one.sequence))
        return table5(runs, layout=layout)

    def _runs(
        self, specs: Sequence[MethodSpec], sequences: Sequence[FolderSequence]
    ) -> Iterator[MadeRun]:
        """Every method on every sequence, with each kind of first pose that it can start from there."""
        from asdfviz.methods.variants import first_poses

        table = "table4" if self.table == "table4" else "table5"
        for spec in specs:
            config: Any = knowing_no_loss(spec)
            for sequence in sequences:
                kinds = first_poses(config, known_assembly(sequence, "--models"))
                for kind in kinds or [None]:
                    chosen, name = config, f"{table}-{spec.name}"
                    if kind is not None:
                        chosen = dataclasses.replace(config, first_pose=kind)
                        name = f"{name}-{kind}"
                    run = self._run(spec, sequence, chosen, name)
                    if run is not None:
                        yield MadeRun(run, chosen, kind, sequence)

    def _open(self, folder: Path) -> FolderSequence:
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.sequences import open_sequence

        known = None if self.models is None else load_assembly(self.models / folder.parent.name)
        return open_sequence(folder, assembly=known)

    def _run(
        self, spec: MethodSpec, sequence: FolderSequence, config: object, name: str
    ) -> Run | None:
        """The run that lies beside the sequence, made if need be; None where weights are missing."""
        from asdfviz.data.atomic import results_in
        from asdfviz.data.run_files import save_run

        folder = Path(sequence.path) / "runs" / name
        kept = None if self.again else kept_run(folder, sequence, config)
        if kept is not None:
            return kept
        try:
            with results_in(folder):
                result = made_run(
                    spec,
                    sequence,
                    config,
                    title=f"{name} {sequence.path}",
                    if_stopped="runs that were finished are kept for the next time",
                )
        except WeightsError as error:
            print(f"{spec.name} is left out on {sequence.path}: {error}", file=sys.stderr)
            return None
        save_run(result, folder)
        return result


def judged_set(found: Judgement, first_pose: object) -> JudgedSet:
    """A judged run as Table 4 takes it."""
    from asdfviz.evaluate.evaluate import protocol_report
    from asdfviz.evaluate.paper_table4 import JudgedSet
    from asdfviz.evaluate.summary import TRUTH, start_told

    start = start_told([found.run.initial])
    poses = [*([TRUTH] if start == TRUTH else []), *([str(first_pose)] if first_pose else [])]
    return JudgedSet(
        found.run.method,
        ", ".join(poses) or "-",
        found.assembly.name,
        protocol_report(found, protocol="gbot"),
        protocol_report(found, protocol="strict"),
    )


def judged_run(
    found: Judgement, kept: Judgement, first_pose: object, sequence: FolderSequence
) -> JudgedRun:
    """A judged run as Table 5 takes it; `kept` is the same without the poses that it says are lost."""
    from asdfviz.evaluate.evaluate import protocol_report
    from asdfviz.evaluate.paper_table5 import JudgedRun

    return JudgedRun(
        found.run.method,
        str(first_pose or "-"),
        f"{found.assembly.name}/{Path(sequence.path).name}",
        found.run.initial,
        protocol_report(found, protocol="gbot"),
        protocol_report(kept, protocol="gbot"),
        protocol_report(found, protocol="strict"),
    )


def set_facts(sequence: FolderSequence) -> SetFacts:
    """Count what is in a test set."""
    from asdfviz.evaluate.paper_table1 import SetFacts

    assembly = known_assembly(sequence, "--models")
    truth = known_truth(sequence, assembly)
    return SetFacts(
        assembly=assembly.name,
        name=Path(sequence.path).name,
        parts=len(assembly.parts),
        states=len(assembly.steps),
        errors=len(assembly.errors),
        frames=len(sequence),
        width=sequence.camera.width,
        height=sequence.camera.height,
        error_frames=sum(bool(one.is_error) for one in truth.values()),
    )


def without_lost(run: Run, config: object) -> Run:
    """A run without the poses that its tracker takes to be lost; others' runs as they are."""
    from asdfviz.methods.part_poses import sure_enough
    from asdfviz.methods.tracking import PartTrackerConfig

    if not isinstance(config, PartTrackerConfig):
        return run
    least = config.settings.confidence.lost_below
    return dataclasses.replace(
        run,
        predictions=tuple(
            dataclasses.replace(one, poses=sure_enough(one.poses, least)) for one in run.predictions
        ),
    )


NOTE = (
    "paper: the ASDF paper's own figures, on its own sequences. gbot: ours by its rules, where a "
    "missing pose costs nothing; kept: the same without what a tracker itself says is lost. "
    "strict: a missing pose is a miss. Methods whose start is 'truth' were handed the true poses "
    "of the first frame, as in the paper, and are not judged on it; those trackers give the poses "
    "of lost parts too, as published, but run with our settings and follow fast and hidden parts, "
    "which the published ones do not (`asdfviz run --published`). Keypoints are the paper's kind of "
    "first pose in our steps; `--runs` has rows for what `run --method asdf --published` wrote."
)


NOTE_TABLE1 = "paper: the ASDF paper's own test sets; ours are built alike and are not the same."
NOTE_TABLE4 = (
    "paper: the ASDF paper's own figures, on its own test sets; of its baseline, the mean. gbot: "
    "ours by its rules, F1 counted as the paper's. strict: a missing pose is a miss. A method whose first pose is "
    "'truth' was handed the true poses of the first frame and is not judged on it. Keypoints are the "
    "paper's kind of first pose in our steps; `--runs` has rows for what `run --method asdf --published` wrote."
)


def condition_folders(data: Path, *, names: Sequence[str] = CONDITIONS) -> list[Path]:
    """The sequences of all assemblies, by name.

    Raises:
        InputError: there are none.
    """
    found = [
        assembly / name
        for assembly in sorted(p for p in data.glob("*") if p.is_dir())
        for name in names
        if (assembly / name / "rgb").is_dir()
    ]
    if not found:
        raise InputError(
            f"{data} holds no test sets (<assembly>/{'|'.join(names)}): make them with "
            f"`asdfviz synth testset --assembly NAME --out {data}`"
        )
    return found


def knowing_no_loss(spec: MethodSpec) -> object:
    """A method's config as its paper has it: trackers that know no loss say all their poses."""
    config: Any = spec.config()
    if hasattr(config, "report_lost"):
        return dataclasses.replace(config, report_lost=True)
    return config
