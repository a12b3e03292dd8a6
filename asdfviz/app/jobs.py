"""Work in the background: a method on this sequence, the check, the evaluation. Nothing here knows viser."""

from __future__ import annotations

import dataclasses
import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from asdfviz import __version__
from asdfviz.app.carrying import Carry, CarryJob
from asdfviz.app.items import JobStatus, Message
from asdfviz.app.truths import drawn_truth, truth_of
from asdfviz.app.workspace import Workspace
from asdfviz.data.run_files import save_run
from asdfviz.datatypes import FramePrediction, Run
from asdfviz.errors import AsdfvizError, MethodError
from asdfviz.evaluate.evaluate import evaluate_run
from asdfviz.evaluate.health import check_sequence
from asdfviz.export.bop import export_bop
from asdfviz.methods.spec import MethodSpec
from asdfviz.run import resolved_config, run

PUBLISH_EVERY = 0.25
"""Seconds between two looks at a run that is still being computed."""


class MethodJob:
    """Runs a method on the workspace's sequence; its poses show while it works and are saved at the end."""

    def __init__(self, workspace: Workspace, spec: MethodSpec, config: object) -> None:
        self._workspace = workspace
        self._spec = spec
        self._config = config
        self._folder = next_run_folder(workspace.runs_folder, spec.name)
        self._id = str(self._folder)
        self._stopped = threading.Event()
        self._predictions: list[FramePrediction] = []
        self._kept: Run | None = None
        self._published = 0.0
        self._thread = threading.Thread(target=self._work, name=f"run {spec.name}", daemon=True)
        self._set(JobStatus(spec.name, "running", total=len(workspace.frames)))

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Ask to stop after the frame at hand; what is done by then is kept."""
        self._stopped.set()
        status = self._workspace.job
        if status is not None and status.state == "running":
            self._set(replace(status, state="stopping"))

    def wait(self, seconds: float | None = None) -> None:
        """Wait for the end."""
        self._thread.join(seconds)

    def _work(self) -> None:
        try:
            result = run(
                self._spec,
                self._workspace.frames.source,
                config=self._config,
                progress=self._progress,
                stop=self._stopped.is_set,
                keep=self._keep,
                prepare=self._prepare,
            )
        except (AsdfvizError, OSError) as error:
            self._fail(str(error))
        else:
            self._finish(result)

    def _prepare(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._published >= PUBLISH_EVERY:
            self._published = now
            state = "stopping" if self._stopped.is_set() else "running"
            self._set(JobStatus(self._spec.name, state, done, total, preparing=True))

    def _keep(self, so_far: Run) -> None:
        self._kept = so_far

    def _progress(self, done: int, total: int, prediction: FramePrediction) -> None:
        self._predictions.append(prediction)
        now = time.monotonic()
        if done > 1 and now - self._published < PUBLISH_EVERY:
            return
        self._published = now
        self._workspace.put_run(self._partial(), self._id)
        times = [p.runtime.get("total", np.nan) for p in self._predictions[-20:]]
        known = [t for t in times if t == t]
        state = "stopping" if self._stopped.is_set() else "running"
        self._set(
            JobStatus(
                self._spec.name,
                state,
                done=done,
                total=total,
                milliseconds=1000 * float(np.median(known)) if known else None,
            )
        )

    def _partial(self) -> Run:
        return Run(
            method=self._spec.name,
            config=dataclasses.asdict(resolved_config(self._config, self._workspace.assembly)),
            sequence=self._workspace.frames.path,
            assembly=self._workspace.assembly.path,
            version=__version__,
            predictions=tuple(self._predictions),
        )

    def _finish(self, result: Run) -> None:
        done, total = len(result.predictions), len(self._workspace.frames)
        if not done:
            self._workspace.drop_run(self._id)
            self._set(JobStatus(self._spec.name, "stopped", total=total, message="nothing done"))
            return
        state = "done" if done == total else "stopped"
        problem = self._save(result)
        if problem:
            state = "failed"
            self._workspace.say(Message(f"{self._spec.name}: not saved", problem, is_problem=True))
        self._set(JobStatus(self._spec.name, state, done=done, total=total, message=problem))

    def _save(self, result: Run) -> str:
        """Show a run and keep it on disk; returns why that failed, if it did."""
        try:
            save_run(result, self._folder)
        except (AsdfvizError, OSError) as error:
            self._workspace.put_run(result, self._id)
            return f"the run is shown but could not be saved to {self._folder}: {error}"
        self._workspace.put_run(result, self._id, folder=self._folder)
        return ""

    def _fail(self, message: str) -> None:
        done, total = 0, len(self._workspace.frames)
        if self._kept is None:
            self._workspace.drop_run(self._id)
        else:
            done = len(self._kept.predictions)
            kept = f"{done} of {total} frames are kept in {self._folder}"
            message = f"{message}; {self._save(self._kept) or kept}"
        self._set(JobStatus(self._spec.name, "failed", done=done, total=total, message=message))
        self._workspace.say(Message(f"{self._spec.name} failed", message, is_problem=True))

    def _set(self, status: JobStatus) -> None:
        self._workspace.job = status
        self._workspace.changed()


class Background:
    """Starts and stops the workspace's background work; one method at a time."""

    def __init__(self, workspace: Workspace) -> None:
        self._workspace = workspace
        self._job: MethodJob | None = None
        self._carrying: CarryJob | None = None
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

    def stop(self) -> None:
        """Ask the running method to stop."""
        with self._lock:
            if self._job is not None:
                self._job.stop()

    def track(self, carry: Carry) -> None:
        """Begin to carry annotated poses to other frames.

        Raises:
            MethodError: a tracker is at work already.
        """
        with self._lock:
            status = self._workspace.carrying
            if status is not None and status.is_active:
                raise MethodError(f"{status.method} is still being tracked: cancel it or wait")
            self._carrying = CarryJob(self._workspace, carry)
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

    def export(self, base: str | None) -> None:
        """Export what is drawn."""
        start_export(self._workspace, base)

    def close(self) -> None:
        """Stop and wait a moment."""
        self.stop()
        self.stop_tracking()
        with self._lock:
            jobs = (self._job, self._carrying)
        for job in jobs:
            if job is not None:
                job.wait(10.0)


def next_run_folder(runs: Path, method: str) -> Path:
    """A folder that is not there yet: asdf, asdf-2, asdf-3 ..."""
    safe = re.sub(r"[^A-Za-z0-9._-]+", "_", method) or "run"
    names = (safe if n == 1 else f"{safe}-{n}" for n in range(1, 10_000))
    free = next((runs / name for name in names if not (runs / name).exists()), None)
    if free is None:
        raise MethodError(f"{runs} holds 9999 runs of '{method}': move some of them away")
    return free


def start_check(workspace: Workspace) -> threading.Thread:
    """Look for wrong units, sizes and shifts in the background; the findings appear when they are there."""

    def work() -> None:
        workspace.findings = tuple(check_sequence(workspace.frames.source).findings)

    return _start(workspace, work, "check")


def start_judging(workspace: Workspace) -> threading.Thread:
    """Judge every saved run against the truth, corrected where it was corrected."""
    workspace.is_judging = True
    workspace.changed()

    def work() -> None:
        try:
            truth = truth_of(workspace)
            workspace.reports = tuple(
                {
                    **evaluate_run(
                        loaded.run,
                        assembly=workspace.assembly,
                        truth=truth,
                        camera=workspace.frames.camera,
                        sequence_name=workspace.frames.name,
                    ),
                    "run": loaded.id,
                }
                for loaded in workspace.runs
            )
        finally:
            workspace.is_judging = False

    return _start(workspace, work, "judge")


def start_export(workspace: Workspace, base: str | None) -> threading.Thread:
    """Write what is drawn, corrections included, as a BOP scene."""

    def work() -> None:
        export_bop(workspace.frames.source, drawn_truth(workspace, base), workspace.export_folder)
        workspace.say(Message("Exported", str(workspace.export_folder)))

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
