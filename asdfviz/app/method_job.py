"""A method at work on the workspace's sequence, in a thread of its own. Nothing here knows viser."""

from __future__ import annotations

import contextlib
import dataclasses
import re
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from asdfviz import __version__
from asdfviz.app.background_job import BackgroundJob
from asdfviz.app.items import JobStatus, Message
from asdfviz.app.truths import unfinished_seed
from asdfviz.app.workspace import Workspace
from asdfviz.data.run_files import save_run
from asdfviz.datatypes import FramePrediction, Run
from asdfviz.errors import AsdfvizError, MethodError
from asdfviz.methods.spec import MethodSpec
from asdfviz.run import resolved_config, run

PUBLISH_EVERY = 0.25
"""Seconds between two looks at a run that is still being computed."""
_PACE_FRAMES = 20


def pace_of(predictions: Sequence[FramePrediction]) -> float | None:
    """Median milliseconds of the last frames; None before any is known.

    The first frame does not count: what it uses is compiled and loaded in it, which takes seconds and tells nothing
    of the frames to come.
    """
    times = [p.runtime.get("total", np.nan) for p in predictions[1:][-_PACE_FRAMES:]]
    known = [t for t in times if t == t]
    return 1000 * float(np.median(known)) if known else None


class MethodJob(BackgroundJob):
    """Runs a method on the workspace's sequence; its poses show while it works and are saved at the end."""

    def __init__(self, workspace: Workspace, spec: MethodSpec, config: object) -> None:
        super().__init__(workspace, "job", thread=f"run {spec.name}")
        self._spec = spec
        self._config = config
        self._folder = _folder_for(workspace, spec.name)
        self._id = str(self._folder)
        self._predictions: list[FramePrediction] = []
        self._kept: Run | None = None
        self._published = 0.0
        self._set(JobStatus(spec.name, "running", total=len(workspace.frames)))

    def _work(self) -> None:
        result = run(
            self._spec,
            self._workspace.frames.source,
            config=self._config,
            progress=self._progress,
            stop=self._stopped.is_set,
            keep=self._keep,
            prepare=self._prepare,
        )
        self._finish(result)

    def _prepare(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._published >= PUBLISH_EVERY:
            self._published = now
            self._set(JobStatus(self._spec.name, self._state, done, total, preparing=True))

    def _keep(self, so_far: Run) -> None:
        self._kept = so_far

    def _progress(self, done: int, total: int, prediction: FramePrediction) -> None:
        self._predictions.append(prediction)
        now = time.monotonic()
        if done > 1 and now - self._published < PUBLISH_EVERY:
            return
        self._published = now
        self._workspace.put_run(self._partial(), self._id, home=self._folder)
        self._set(
            JobStatus(
                self._spec.name,
                self._state,
                done=done,
                total=total,
                milliseconds=pace_of(self._predictions),
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
            says_states="state" in self._spec.predicts,
        )

    def _finish(self, result: Run) -> None:
        done, total = len(result.predictions), len(self._workspace.frames)
        if not done:
            self._drop()
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
            self._workspace.put_run(result, self._id, home=self._folder)
            return f"the run is shown but could not be saved to {self._folder}: {error}"
        self._workspace.put_run(result, self._id, folder=self._folder)
        return ""

    def _fail(self, message: str) -> None:
        done, total = 0, len(self._workspace.frames)
        if self._kept is None:
            self._drop()
        else:
            done = len(self._kept.predictions)
            kept = f"{done} of {total} frames are kept in {self._folder}"
            message = f"{message}; {self._save(self._kept) or kept}"
        self._set(JobStatus(self._spec.name, "failed", done=done, total=total, message=message))
        self._workspace.say(Message(f"{self._spec.name} failed", message, is_problem=True))

    def _drop(self) -> None:
        self._workspace.drop_run(self._id)
        if unfinished_seed(self._workspace) == self._folder:
            return  # for the next try
        with contextlib.suppress(OSError):
            self._folder.rmdir()  # empty, or it stays


def _folder_for(workspace: Workspace, method: str) -> Path:
    """A folder of its own, or that of the method's run that corrections started from but was never saved.

    They go on from the run that takes its place; another would leave them without any.
    """
    begun = unfinished_seed(workspace)
    if begun is None or workspace.store.seed().method != method:
        return _reserved(workspace.runs_folder, method)
    told = f"{method} takes the place of the run that they started from, which was never saved"
    workspace.say(Message("Corrections go on from this run", told))
    return begun


def _reserved(runs: Path, method: str) -> Path:
    """A folder of its own, made at once, as another app may work on this sequence too."""
    folder = next_run_folder(runs, method)
    while True:
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            folder = next_run_folder(runs, method)
        except OSError:
            return folder  # told when the run cannot be saved
        else:
            return folder


def next_run_folder(runs: Path, method: str) -> Path:
    """A folder that is not there yet: asdf, asdf-2, asdf-3 ...

    Raises:
        MethodError: what is there cannot be read, or all names are taken.
    """
    safe = re.sub(r"[^A-Za-z0-9._-]+", "_", method) or "run"
    names = (safe if n == 1 else f"{safe}-{n}" for n in range(1, 10_000))
    try:
        free = next((runs / name for name in names if not (runs / name).exists()), None)
    except OSError as error:
        raise MethodError(
            f"runs cannot be kept in {runs}, which cannot be read ({error.strerror}): "
            "ask whose it is for access, or move it away"
        ) from error
    if free is None:
        raise MethodError(f"{runs} holds 9999 runs of '{method}': move some of them away")
    return free
