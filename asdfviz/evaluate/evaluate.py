"""Judges a run: poses, states and times against the truth, as one JSON-ready dictionary.

The command line prints what comes out of here and the app's result tab shows it. A run is only read,
no method is called.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from asdfviz.datatypes import Assembly, Camera, FramePrediction, FrameTruth, Run
from asdfviz.errors import SequenceError
from asdfviz.evaluate.bop import DepthDrawer, View, Views, bop_recall
from asdfviz.evaluate.calibration import calibration_error, ranking_area, reliability
from asdfviz.evaluate.inputs import Result, changed_inputs, open_result, unknown_objects
from asdfviz.evaluate.judgement import Judgement, judge
from asdfviz.evaluate.not_found import with_rows_not_found
from asdfviz.evaluate.offline_states import OFFLINE
from asdfviz.evaluate.protocols import (
    DIAMETER_SHARE,
    TWINS,
    VISIBLE,
    Figures,
    ProtocolName,
    mean,
    median,
    percentile,
    pose_figures,
)
from asdfviz.evaluate.records import PoseRecord
from asdfviz.evaluate.state_scores import (
    StateRecord,
    confidences,
    confusion_matrix,
    micro_f1,
    state_figures,
    true_transitions,
)
from asdfviz.evaluate.summary import HELD, START, start_told

DETECT = "detect"
"""The stage in which methods with a detector find boxes, and name them."""


def evaluate_folder(
    run_folder: Path,
    *,
    protocol: ProtocolName = "strict",
    truth_folder: Path | None = None,
    assembly: Assembly | None = None,
    sequence: str | None = None,
    scene: str | None = None,
) -> dict[str, Any]:
    """Judge a saved run, or a csv, against the truth of its own sequence or of another folder.

    Args:
        run_folder: what `asdfviz run` wrote, or a csv of BOP or GBOT.
        protocol: what counts, see `asdfviz.evaluate.protocols`.
        truth_folder: holds scene_gt.json and states.json; None for the run's sequence.
        assembly: None for the one that the run names.
        sequence: the frames that a csv is about.
        scene: whose rows of a csv to take.

    Raises:
        InputError: the run, its assembly or the truth cannot be read or do not fit.
    """
    result = open_result(
        run_folder, truth_folder=truth_folder, assembly=assembly, sequence=sequence, scene=scene
    )
    return evaluate_result(result, protocol=protocol, truth_folder=truth_folder)


def evaluate_result(
    result: Result, *, protocol: ProtocolName = "strict", truth_folder: Path | None = None
) -> dict[str, Any]:
    """Judge what `open_result` gave; `truth_folder` is the one that it was given.

    Raises:
        InputError: the run does not fit its assembly, or frames cannot be read.
    """
    report = evaluate_run(
        result.run,
        assembly=result.assembly,
        truth=result.truth,
        protocol=protocol,
        views=result.view,
    )
    truth_from = Path(result.run.sequence) if truth_folder is None else truth_folder
    warnings = [
        *report.get("warnings", ()),
        *changed_inputs(result.run, result.assembly),
        *unknown_objects(truth_from, result.assembly),
    ]
    return {**report, "warnings": warnings} if warnings else report


def evaluate_run(
    run: Run,
    *,
    assembly: Assembly,
    truth: Mapping[int, FrameTruth],
    camera: Camera | None = None,
    protocol: ProtocolName = "strict",
    sequence_name: str | None = None,
    views: Views | None = None,
) -> dict[str, Any]:
    """Return all figures of a run; shares in percent, mm, degrees and ms, None where undefined.

    Args:
        run: what a method said.
        assembly: what it was about.
        truth: by frame number.
        camera: of all frames, where there are no `views`: needed where the truth lacks visible
            shares, to render them, and for `bop`.
        protocol: what counts, see `asdfviz.evaluate.protocols`.
        sequence_name: name in the report; None for the last part of the run's path.
        views: cameras and measured depth: for `bop`, which renders the truth without it, and for
            what hides parts whose shares the truth lacks.

    Raises:
        RunError: the run does not fit the assembly or holds a pose that is none.
        SequenceError: something has to be rendered and there is no camera.
    """
    if views is None and camera is not None:
        views = _views_by(camera)
    found = judge(run, assembly=assembly, truth=truth, views=views)
    report = protocol_report(found, protocol=protocol, sequence_name=sequence_name)
    if protocol == "bop":
        if views is None:
            raise SequenceError("the protocol bop renders the parts, and there is no camera for it")
        _add_bop(report, found, views)
    return report


def protocol_report(
    judgement: Judgement, *, protocol: ProtocolName, sequence_name: str | None = None
) -> dict[str, Any]:
    """Count a judgement by a protocol: the report of `evaluate_run` without average recalls."""
    run, assembly, states = judgement.run, judgement.assembly, judgement.states
    compared = judgement.comparison
    if protocol == "gbot":
        compared = with_rows_not_found(compared, judgement.predictions, assembly)
    parts, means = pose_figures(compared, assembly, protocol)
    was_given = run.initial == "first_frame_truth"
    report: dict[str, Any] = {
        "method": run.method,
        START: start_told([run.initial]),
        "sequence": Path(run.sequence).name if sequence_name is None else sequence_name,
        "protocol": protocol,
        "n_frames": len(judgement.frames),
        "parts": parts,
        "mean": {**means, **_score_figures(judgement), "ar_bop": None},
        "state": _state_figures(states, protocol, first_was_given=was_given),
        "runtime_ms": runtime_figures(run.predictions),
        "assembly": assembly.name,
        "state_details": _state_details(states, assembly),
    }
    if judgement.offline:
        found = _state_figures(judgement.offline, protocol, first_was_given=was_given)
        report[OFFLINE] = {**found, "ece": None}  # a path is not more or less sure
    if judgement.n_held < len(judgement.frames):
        report[HELD] = judgement.n_held
    warnings = list(judgement.warnings)
    return {**report, "warnings": warnings} if warnings else report


def _add_bop(report: dict[str, Any], judgement: Judgement, views: Views) -> None:
    """Add average recalls, and whether VSD saw measured or rendered depth."""
    # OpenGL is loaded only where something is drawn.
    from asdfviz.render.renderer import Renderer

    renderers: dict[tuple[int, int], Renderer] = {}

    def draw(camera: Camera) -> DepthDrawer:
        size = (camera.width, camera.height)
        return renderers.get(size) or renderers.setdefault(size, Renderer(*size))

    try:
        found = bop_recall(
            judgement.comparison.records,
            judgement.predictions,
            judgement.frames,
            judgement.assembly,
            views=views,
            draw=draw,
        )
    finally:
        for renderer in renderers.values():
            renderer.close()
    for name, figures in found.parts.items():
        report["parts"][name] |= figures
    report["mean"] |= found.mean
    report["vsd_depth"] = {
        "measured_frames": found.frames_measured,
        "rendered_frames": found.frames_rendered,
    }


def _views_by(camera: Camera) -> Views:
    return lambda frame_index: View(camera, None)


def _score_figures(judgement: Judgement) -> Figures:
    """How well the score of a found pose tells ADD(S) < 0.1 d from worse: area under the ROC.

    And how far it is from the share of such poses (expected calibration error). With the poses of twins
    exchanged too.
    """
    parts, compared = judgement.assembly.parts, judgement.comparison

    def judged(records: Sequence[PoseRecord]) -> list[tuple[float, bool]]:
        return [
            (r.score, r.error.add_s < DIAMETER_SHARE * parts[r.part].diameter)
            for r in records
            if r.error is not None and r.score is not None and r.visible >= VISIBLE
        ]

    own, exchanged = judged(compared.records), judged(compared.exchanged)
    return {
        "score_auc": ranking_area(own),
        f"score_auc{TWINS}": ranking_area(exchanged),
        "score_ece": calibration_error(own),
        f"score_ece{TWINS}": calibration_error(exchanged),
    }


def _state_figures(
    states: Sequence[StateRecord], protocol: ProtocolName, *, first_was_given: bool
) -> Figures:
    figures = state_figures(states)
    if protocol == "gbot":
        figures["micro_f1"] = micro_f1(states, first_was_given=first_was_given)
    return figures


def _state_details(states: Sequence[StateRecord], assembly: Assembly) -> dict[str, Any]:
    """What is no figure of merit: frames with a known state, confusion, transitions, calibration curve."""
    followed, _ = true_transitions(states)
    return {
        "frames": len(states),
        "confusion": confusion_matrix(states, assembly),
        "transitions": [
            {"frame": t.frame, "from": t.before, "to": t.after, "delay_frames": t.delay}
            for t in followed
        ],
        "reliability": [
            {"count": b.count, "confidence": 100 * b.confidence, "accuracy": 100 * b.accuracy}
            for b in reliability(confidences(states))
        ],
    }


def runtime_figures(predictions: Iterable[FramePrediction]) -> Figures:
    """Median milliseconds by stage; median, mean and 95th percentile of the whole frame.

    Of methods with a detector likewise of all that comes after it (`after_detect`).
    """
    times_ms: dict[str, list[float]] = {}
    after: list[float] = []
    for prediction in predictions:
        runtime = prediction.runtime
        for stage, seconds in runtime.items():
            times_ms.setdefault(stage, []).append(1000.0 * seconds)
        if "total" in runtime:
            after.append(1000.0 * (runtime["total"] - runtime.get(DETECT, 0.0)))
    totals = times_ms.pop("total", [])
    stages: Figures = {stage: median(values) for stage, values in times_ms.items()}
    figures = {**stages, "total_median": median(totals), "total_mean": mean(totals)}
    figures["total_p95"] = percentile(totals, 95.0)
    if DETECT in stages:
        figures |= {
            "after_detect_median": median(after),
            "after_detect_p95": percentile(after, 95.0),
        }
    return figures
