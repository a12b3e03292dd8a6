"""Work in the background: methods, the tracker, the check, the evaluation. Nothing here knows viser."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any

from asdfviz.annotate.records import gone_of
from asdfviz.app.by_state import told_off
from asdfviz.app.carrying import Carry, CarryJob
from asdfviz.app.fitting import Fit, FitJob
from asdfviz.app.items import PROGRAM_FAULT, LoadedRun, Message
from asdfviz.app.method_job import MethodJob
from asdfviz.app.stopped import note_stopped
from asdfviz.app.truths import exported_truth, truth_of
from asdfviz.app.workspace import Workspace
from asdfviz.datatypes import FrameTruth
from asdfviz.errors import AsdfvizError, MethodError
from asdfviz.evaluate.bop import views_of
from asdfviz.evaluate.evaluate import protocol_report
from asdfviz.evaluate.health import Finding, check_sequence
from asdfviz.evaluate.judgement import judge
from asdfviz.evaluate.worst import worst_frames
from asdfviz.export.bop import export_bop
from asdfviz.export.gaps import told_gaps
from asdfviz.export.readable import told_left_out
from asdfviz.methods.spec import MethodSpec


class Background:
    """Starts and stops the workspace's background work; one method at a time."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._job: MethodJob | None = None
        self._carrying: CarryJob | FitJob | None = None
        self._lock = threading.Lock()

    def run(self, spec: MethodSpec, config: object | None = None) -> None:
        """Begin to run a method, with its default config unless another is given.

        Raises:
            MethodError: one is running already.
        """
        with self._lock:
            status = self._workspace.job
            if status is not None and status.is_active:
                raise MethodError(f"{status.method} is still running: stop it or wait for its end")
            config = spec.config() if config is None else config
            self._job = MethodJob(self._workspace, spec, config)
            self._job.start()
        note_stopped(self._workspace.store, spec.name, stopped=False)

    def stop(self) -> None:
        """Ask the running method to stop, and never to begin by itself again.

        Raises:
            AnnotationError: it stops, but that cannot be kept.
        """
        with self._lock:
            status = self._workspace.job
            if self._job is None or status is None or not status.is_active:
                return
            self._job.stop()
        note_stopped(self._workspace.store, status.method, stopped=True)

    def track(self, carry: Carry) -> None:
        """Begin to carry annotated poses to other frames.

        Raises:
            MethodError: a tracker is at work already.
        """
        self._begin(lambda: CarryJob(self._workspace, carry))

    def fit(self, fit: Fit) -> None:
        """Begin to settle a part in a frame.

        Raises:
            MethodError: a tracker is at work already.
        """
        self._begin(lambda: FitJob(self._workspace, fit))

    def _begin(self, job: Callable[[], CarryJob | FitJob]) -> None:
        with self._lock:
            status = self._workspace.carrying
            if status is not None and status.is_active:
                raise MethodError(f"{status.told} still goes on: cancel it or wait")
            self._carrying = job()
            self._carrying.start()

    def stop_tracking(self) -> None:
        """Ask the tracker to stop; nothing is changed then."""
        with self._lock:
            if self._carrying is not None:
                self._carrying.stop()

    def judge(self) -> None:
        """Judge every run."""
        if not self._workspace.is_judging:
            start_judging(self._workspace)

    def export(self, base: str | None, *, guesses: bool) -> None:
        """Export what is drawn, a run's guesses only if asked."""
        start_export(self._workspace, base, guesses=guesses)

    def close(self) -> None:
        """Stop and wait a moment; what works now may begin by itself when the app is opened again."""
        with self._lock:
            jobs = [job for job in (self._job, self._carrying) if job is not None]
        for job in jobs:
            job.stop()
        for job in jobs:
            job.wait(10.0)


def start_check(workspace: Workspace) -> threading.Thread:
    """Look for wrong units, sizes and shifts in the background; a check that fails is a finding, too."""

    def work() -> None:
        why = PROGRAM_FAULT
        try:
            workspace.findings = tuple(check_sequence(workspace.frames.source).findings)
        except (AsdfvizError, OSError) as error:
            why = str(error)
            raise
        finally:
            # Else it would seem to work for good.
            if workspace.findings is None:
                workspace.findings = (Finding("unchecked", "error", f"It was not checked: {why}"),)
                workspace.changed()

    return _start(workspace, work, "check")


def start_judging(workspace: Workspace) -> threading.Thread:
    """Judge every saved run against the truth, corrected where it was corrected."""
    workspace.is_judging = True
    workspace.changed()

    def work() -> None:
        try:
            # Read first: what is corrected meanwhile may or may not be in the truth.
            corrections = workspace.store.corrections()
            truth = truth_of(workspace)
            reports = tuple(_judged(workspace, loaded, truth) for loaded in workspace.runs)
            workspace.reports, workspace.judged = reports, corrections
        finally:
            workspace.is_judging = False

    return _start(workspace, work, "judge")


def _judged(
    workspace: Workspace, loaded: LoadedRun, truth: Mapping[int, FrameTruth]
) -> dict[str, Any]:
    """A run's report, whose it is, whether it compares with others, and where it is worst."""
    found = judge(
        loaded.run,
        assembly=workspace.assembly,
        truth=truth,
        views=views_of(workspace.frames.source),
    )
    name = workspace.frames.name
    return {
        **protocol_report(found, protocol="strict", sequence_name=name),
        "run": loaded.id,
        "is_comparable": found.is_comparable,
        "worst": worst_frames(found.comparison.records),
    }


def start_export(
    workspace: Workspace, base: str | None, *, guesses: bool = False
) -> threading.Thread:
    """Write what is drawn, corrections included, as a BOP scene; a run's guesses only if asked."""

    def work() -> None:
        checked = exported_truth(workspace, base, guesses=guesses)
        truth, gone = checked.truth, gone_of(workspace.said())
        source, folder = workspace.frames.source, workspace.export_folder
        left_out = export_bop(source, truth, folder, gone=gone)
        workspace.say(Message("Exported", str(folder)))
        if checked.told:
            workspace.say(Message("Not everything was checked", checked.told))
        parts = workspace.assembly.parts
        if gaps := told_gaps(truth, workspace.indices, parts, gone=gone):
            workspace.say(Message("Some poses are missing", gaps))
        if off := told_off(workspace, base, truth):
            workspace.say(Message("Some poses no longer fit", off, is_problem=True))
        if left_out:
            workspace.say(Message("Not all exported", told_left_out(left_out), is_problem=True))

    return _start(workspace, work, "export")


def _start(workspace: Workspace, work: Callable[[], None], name: str) -> threading.Thread:
    def guarded() -> None:
        try:
            work()
        except (AsdfvizError, OSError) as error:
            workspace.say(Message(f"Could not {name}", str(error), is_problem=True))
        workspace.changed()

    thread = threading.Thread(target=guarded, name=name, daemon=True)
    thread.start()
    return thread
