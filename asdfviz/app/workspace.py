"""What all browser tabs share: the sequence, its truth, runs, corrections, and what is being computed.

Readable from any thread; whoever changes something calls `changed`, and every tab hears of it.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from asdfviz.annotate.corrected import run_of_seed
from asdfviz.annotate.records import BY_STATE, TRACKED, Said, Seed
from asdfviz.annotate.spoken import NOTHING, Spoken, up_to_date
from asdfviz.annotate.store import AnnotationStore
from asdfviz.app import strips, theme, timeline
from asdfviz.app.items import ANNOTATION, JobStatus, LoadedRun, Message, Shown
from asdfviz.app.lanes import Lane, lane_of
from asdfviz.app.pages import Pages
from asdfviz.app.view import TRUTH, Facts
from asdfviz.data.prefetch import Prefetcher
from asdfviz.datatypes import Assembly, Run, Stage, State
from asdfviz.datatypes import Sequence as FrameSequence
from asdfviz.evaluate.health import Finding
from asdfviz.geometry.shapes import Transform

FIRST_METHOD = "asdf"
"""Its run is drawn first; it is run by itself where a sequence has no run yet."""

_STAGES: Mapping[str, Stage] = {TRACKED: "tracked", BY_STATE: "group"}
"""Of corrected poses that were derived."""


class Workspace:
    """The shared half of the app's state."""

    def __init__(
        self,
        sequence: FrameSequence,
        assembly: Assembly,
        *,
        store: AnnotationStore,
        runs_folder: Path,
        export_folder: Path,
    ) -> None:
        self.opened = secrets.token_hex(8)
        """Tells this opening of the sequence from others, to pages that are loaded again."""
        self.assembly = assembly
        self.frames = Prefetcher(sequence)
        self.store = store
        self.runs_folder = runs_folder
        """Where new runs are saved."""
        self.export_folder = export_folder
        self.fps = float(getattr(sequence, "fps", 30.0))
        self.indices = sequence.frame_indices
        self.place_of: Mapping[int, int] = {index: i for i, index in enumerate(self.indices)}
        self.truths = tuple(sequence.truth(place) for place in range(len(sequence)))
        self.colors = theme.part_colors(assembly.parts)
        self.findings: tuple[Finding, ...] | None = None
        """None while the check still works."""
        self.job: JobStatus | None = None
        self.carrying: JobStatus | None = None
        """A tracker that carries annotated poses to other frames, or how it ended."""
        self.reports: tuple[Mapping[str, Any], ...] | None = None
        self.judged = 0
        """The corrections that the reports know of."""
        self.messages: tuple[Message, ...] = ()
        """What happened in the background; every tab shows those that it has not shown yet."""
        self.is_judging = False
        self.pages = Pages()
        """The browser tabs that are open."""
        self._runs: tuple[LoadedRun, ...] = ()
        self._changes = 0
        self._lock = threading.RLock()
        self._listeners: list[Callable[[], None]] = []
        self._spoken = NOTHING
        self._lanes: dict[tuple[str | None, str | None], tuple[object, object, Lane]] = {}
        self._rows: tuple[object, tuple[timeline.Row, ...], tuple[int, ...]] | None = None

    @property
    def has_truth(self) -> bool:
        """Whether poses are known from the dataset."""
        return any(truth is not None and truth.T_camera_part for truth in self.truths)

    @property
    def is_stale(self) -> bool:
        """Whether corrections were made since the runs were judged."""
        return self.reports is not None and self.store.corrections() != self.judged

    @property
    def runs(self) -> tuple[LoadedRun, ...]:
        """All runs, in the order of their numbers."""
        return self._runs  # no lock: who writes to the store asks for it while holding that

    def run(self, run_id: str | None) -> LoadedRun | None:
        """The run of an id."""
        return next((run for run in self.runs if run.id == run_id), None)

    def put_run(
        self, run: Run, run_id: str, *, folder: Path | None = None, home: Path | None = None
    ) -> None:
        """Add a run, or replace the one of the same id; one without a folder may have a home yet."""
        home = home or folder
        predictions = {p.frame_index: p for p in run.predictions}
        by_place = tuple(predictions.get(index) for index in self.indices)
        with self._lock:
            self._changes += 1
            known = next((old for old in self._runs if old.id == run_id), None)
            if known is not None:
                fresh = replace(known, run=run, by_place=by_place, folder=folder, home=home)
                self._runs = tuple(fresh if old is known else old for old in self._runs)
                return
            same = sum(old.run.method == run.method for old in self._runs)
            label = run.method if same == 0 else f"{run.method} {same + 1}"
            color = theme.run_color(len(self._runs))
            self._runs += (LoadedRun(run_id, label, color, run, by_place, folder, home),)

    def drop_run(self, run_id: str) -> None:
        """Forget a run, as when it failed before its first frame."""
        with self._lock:
            self._changes += 1
            self._runs = tuple(run for run in self._runs if run.id != run_id)

    def poses(self, place: int, base: str | None) -> dict[str, Shown]:
        """The poses to draw: what was corrected, otherwise what the base (a run, the truth) says."""
        shown = self.base_poses(place, base)
        for (_, name), pose in self.store.poses(self.indices[place]).items():
            if pose.T_camera_part is None:
                shown.pop(name, None)
            elif name in self.assembly.parts:
                stage = _STAGES.get(pose.provenance, "annotated")
                shown[name] = Shown(pose.T_camera_part, ANNOTATION, stage)
        return shown

    def base_poses(self, place: int, base: str | None) -> dict[str, Shown]:
        """The poses that corrections start from."""
        if base == TRUTH:
            true = self.layer(place, TRUTH)
            return {name: Shown(T, TRUTH, "truth") for name, T in true.items()}
        run = self.run(base)
        prediction = None if run is None else run.by_place[place]
        if prediction is None:
            return {}
        return {
            name: Shown(pose.T_camera_part, str(base), pose.stage, pose.score)
            for name, pose in prediction.poses.items()
        }

    def seed_of(self, base: str | None) -> Seed:
        """What the annotation file keeps of where corrections start from."""
        run = self.run(base)
        if run is not None:
            return Seed("run", str(run.home) if run.home else None, run.run.method)
        return Seed("truth") if base == TRUTH else Seed()

    def base_of_seed(self) -> str | None:
        """The run, or the truth, that earlier corrections started from; None where it is not here."""
        seed = self.store.seed()
        if seed.kind == "truth":
            return TRUTH if self.has_truth else None
        if seed.run is None:
            return None
        homes = {run.home: run.id for run in reversed(self.runs)}
        return homes.get(Path(seed.run)) or homes.get(run_of_seed(seed.run, self.frames.source))

    def layer(self, place: int, layer: str) -> dict[str, Transform]:
        """The poses of the truth or of one run."""
        run = self.run(layer)
        if run is not None:
            prediction = run.by_place[place]
            if prediction is None:
                return {}
            return {name: pose.T_camera_part for name, pose in prediction.poses.items()}
        truth = self.truths[place]
        return dict(truth.T_camera_part) if truth else {}

    def rows(self) -> tuple[timeline.Row, ...]:
        """The timeline's rows: annotation, truth, runs."""
        return self._rows_and_boundaries()[0]

    def is_labelled(self, first: int, last: int) -> bool:
        """Whether a person set the state of any place from the first to the last."""
        row = next(row for row in self.rows() if row.key == ANNOTATION)
        return any(row.marks[first : last + 1])

    def mark(self, place: int, base: str | None) -> tuple[timeline.Mark | None, str]:
        """The state at a place and whose word it is: the annotation's, the base's, the truth's."""
        by_key = {row.key: row for row in self.rows()}
        for key in (ANNOTATION, base, TRUTH):
            row = by_key.get(key or "")
            mark = row.marks[place] if row else None
            if row and mark is not None:
                return mark, row.label
        return None, ""

    def attached(self, place: int, base: str | None) -> tuple[str, ...]:
        """The parts that are joined in the state at a place; none where the state is not known."""
        state = self.state(place, base)
        return () if state is None else state.attached

    def state(self, place: int, base: str | None) -> State | None:
        """The state of the assembly at a place; None where it is not known, or is an unknown error."""
        mark, _ = self.mark(place, base)
        named = (state for state in self.assembly.states if mark and state.name == mark.name)
        return next(named, None)

    def said(self) -> Said:
        """What the store has said, asked only for what changed in the annotation."""
        return self._up_to_date().said

    def _up_to_date(self) -> Spoken:
        self._spoken = spoken = up_to_date(self._spoken, self.store)
        return spoken

    def lane(self, part: str | None, base: str | None) -> Lane:
        """Where a part, or any, has a pose; made anew when the annotation, or the base's run, changed."""
        run, said = self.run(base), self.said()
        known = self._lanes.get((part, base))
        if known is None or known[0] is not said or known[1] is not run:
            places = range(len(self.indices))
            lane = lane_of(
                part,
                self.indices,
                self.assembly.parts,
                said=said,
                held=[self.layer(place, base) if base else () for place in places],
                source=(run.label, run.color) if run else ("the truth", theme.TRUTH),
            )
            known = self._lanes[part, base] = (said, run, lane)
        return known[2]

    def _rows_and_boundaries(self) -> tuple[tuple[timeline.Row, ...], tuple[int, ...]]:
        """Made anew only when a run, a verdict or a label changed, and not for every pose."""
        with self._lock:
            spoken = self._up_to_date()
            stamp = (self._changes, spoken.verdicts, spoken.ranges)
            if self._rows is None or self._rows[0] != stamp:
                rows = self._build_rows(spoken)
                self._rows = (stamp, rows, timeline.boundaries(rows))
            return self._rows[1:]

    def facts(self) -> Facts:
        """What the view's rules depend on."""
        camera = self.frames.camera
        runs = [run.id for run in self.runs]
        _, boundaries = self._rows_and_boundaries()
        favourites = [run.id for run in self.runs if run.run.method == FIRST_METHOD]
        return Facts(
            count=len(self.indices),
            parts=tuple(self.assembly.parts),
            boundaries=boundaries,
            runs=tuple(runs),
            preferred=next(reversed(favourites or runs), None),
            has_truth=self.has_truth,
            is_corrected=self.store.corrections() > 0,
            K=camera.K,
            size_wh=(camera.width, camera.height),
        )

    def say(self, message: Message) -> None:
        """Tell every tab."""
        with self._lock:
            self.messages += (message,)
        self.changed()

    def subscribe(self, listener: Callable[[], None]) -> Callable[[], None]:
        """Hear of changes; returns what ends it."""
        with self._lock:
            self._listeners.append(listener)

        def end() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return end

    def changed(self) -> None:
        """Tell every tab that something shared is new."""
        with self._lock:
            listeners = tuple(self._listeners)
        for listener in listeners:
            listener()

    def close(self) -> None:
        """Stop reading ahead and close the annotation file."""
        self.frames.close()
        self.store.close()

    def _build_rows(self, spoken: Spoken) -> tuple[timeline.Row, ...]:
        rows = [strips.annotation_row(self.assembly, spoken, self.indices)]
        true = tuple(timeline.mark_of_truth(self.assembly, truth) for truth in self.truths)
        if any(mark is not None for mark in true):
            rows.append(timeline.Row(TRUTH, "truth", theme.TRUTH, true))
        return (*rows, *(strips.run_row(self.assembly, run) for run in self._runs))
