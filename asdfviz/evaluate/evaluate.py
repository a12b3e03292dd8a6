"""Judges a run: poses, states and times against the truth, as one JSON-ready dictionary.

The command line prints what comes out of here and the app's result tab shows it. A run is only read,
no method is called.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from asdfviz.data.assembly import load_assembly
from asdfviz.data.hashes import assembly_sha256, sequence_sha256
from asdfviz.data.run_files import load_run
from asdfviz.data.sequences import open_sequence
from asdfviz.data.truth import read_truth
from asdfviz.datatypes import Assembly, Camera, FramePrediction, FrameTruth, Run
from asdfviz.errors import RunError, SequenceError
from asdfviz.evaluate.protocols import Figures, ProtocolName, mean, median, pose_figures
from asdfviz.evaluate.records import compare_poses, predictions_by_frame
from asdfviz.evaluate.state_scores import micro_f1, state_figures, state_records
from asdfviz.evaluate.visibility import lacks_visibility, visible_shares


def evaluate_folder(
    run_folder: Path,
    *,
    protocol: ProtocolName = "strict",
    truth_folder: Path | None = None,
    assembly: Assembly | None = None,
) -> dict[str, Any]:
    """Judge a saved run against the truth of its own sequence or of another folder.

    Args:
        run_folder: what `asdfviz run` wrote.
        protocol: what counts, see `asdfviz.evaluate.protocols`.
        truth_folder: holds scene_gt.json and states.json; None for the run's sequence.
        assembly: None for the one that the run names.

    Raises:
        InputError: the run, its assembly or the truth cannot be read or do not fit.
    """
    run = load_run(run_folder)
    assembly = _assembly_of(run, run_folder) if assembly is None else assembly
    truth = _truth_for(run, run_folder, truth_folder, assembly)
    camera = None
    if any(lacks_visibility(frame, assembly) for frame in truth.values()):
        camera = open_sequence(run.sequence, assembly=assembly).camera
    report = evaluate_run(run, assembly=assembly, truth=truth, camera=camera, protocol=protocol)
    warnings = [*report.get("warnings", ()), *changed_inputs(run, assembly)]
    return {**report, "warnings": warnings} if warnings else report


def _assembly_of(run: Run, run_folder: Path) -> Assembly:
    if not Path(run.assembly).is_file():
        raise RunError(
            f"{run_folder}: its assembly {run.assembly} is gone; say where it is with --assembly"
        )
    return load_assembly(run.assembly)


def _truth_for(
    run: Run, run_folder: Path, truth_folder: Path | None, assembly: Assembly
) -> dict[int, FrameTruth]:
    folder = Path(run.sequence) if truth_folder is None else truth_folder
    if not folder.is_dir():
        whose = f"{run_folder}: its sequence" if truth_folder is None else "the truth"
        raise SequenceError(
            f"{whose} {folder} is no folder; say with --truth where scene_gt.json and "
            "states.json are"
        )
    truth = read_truth(folder, assembly)
    if not truth:
        raise SequenceError(f"{folder} holds no truth: scene_gt.json or states.json is needed")
    frames = [prediction.frame_index for prediction in run.predictions]
    if frames and truth.keys().isdisjoint(frames):
        raise SequenceError(
            f"{folder} holds the truth of frames {min(truth)} to {max(truth)}, the run {run_folder} "
            f"frames {min(frames)} to {max(frames)}: they share none, so this is another sequence's"
        )
    return truth


def changed_inputs(run: Run, assembly: Assembly) -> list[str]:
    """Say which inputs of the run are no longer what they were; a run without hashes is believed."""
    found: list[str] = []
    if run.hashes.get("assembly") not in (None, assembly_sha256(assembly)):
        found.append(f"{run.assembly} or a mesh of it changed since the run")
    folder = Path(run.sequence)
    if folder.is_dir() and run.hashes.get("sequence") not in (None, sequence_sha256(folder)):
        found.append(f"images or JSON files of {folder} changed since the run")
    return found


def evaluate_run(
    run: Run,
    *,
    assembly: Assembly,
    truth: Mapping[int, FrameTruth],
    camera: Camera | None = None,
    protocol: ProtocolName = "strict",
    sequence_name: str | None = None,
) -> dict[str, Any]:
    """Return all figures of a run; shares in percent, mm, degrees and ms, None where undefined.

    Every frame of the truth counts, also one that the run does not hold. A run that was handed the
    true poses of the first frame is not judged on that frame.

    Args:
        run: what a method said.
        assembly: what it was about.
        truth: by frame number.
        camera: needed only where the truth lacks visible shares, to render them.
        protocol: what counts, see `asdfviz.evaluate.protocols`.
        sequence_name: name in the report; None for the last part of the run's path.

    Raises:
        RunError: the run does not fit the assembly or holds a pose that is none.
        SequenceError: visible shares are missing and there is no camera.
    """
    predictions = predictions_by_frame(run, assembly)
    frames = judged_frames(run, truth)
    comparison = compare_poses(
        predictions,
        frames,
        assembly=assembly,
        visible=visible_shares(frames, assembly=assembly, camera=camera),
    )
    parts, means = pose_figures(comparison, assembly, protocol)
    states = state_records(frames, predictions, assembly)
    state = state_figures(states)
    if protocol == "gbot":
        state["micro_f1"] = micro_f1(states)
    report: dict[str, Any] = {
        "method": run.method,
        "sequence": Path(run.sequence).name if sequence_name is None else sequence_name,
        "protocol": protocol,
        "n_frames": len(frames),
        "parts": parts,
        "mean": means,
        "state": state,
        "runtime_ms": runtime_figures(run.predictions),
    }
    warnings = _warnings(predictions, truth, frames)
    return {**report, "warnings": warnings} if warnings else report


def judged_frames(run: Run, truth: Mapping[int, FrameTruth]) -> tuple[FrameTruth, ...]:
    """Return the frames that count, in order: all of the truth but the frame that was given."""
    given = run.initial == "first_frame_truth" and run.predictions
    first = run.predictions[0].frame_index if given else None
    return tuple(truth[index] for index in sorted(truth) if index != first)


def runtime_figures(predictions: Iterable[FramePrediction]) -> Figures:
    """Median milliseconds by stage, and median and mean of the whole frame."""
    times_ms: dict[str, list[float]] = {}
    for prediction in predictions:
        for stage, seconds in prediction.runtime.items():
            times_ms.setdefault(stage, []).append(1000.0 * seconds)
    totals = times_ms.pop("total", [])
    stages = {stage: median(values) for stage, values in times_ms.items()}
    return {**stages, "total_median": median(totals), "total_mean": mean(totals)}


def _warnings(
    predictions: Mapping[int, FramePrediction],
    truth: Mapping[int, FrameTruth],
    frames: tuple[FrameTruth, ...],
) -> list[str]:
    found: list[str] = []
    absent = [frame.frame_index for frame in frames if frame.frame_index not in predictions]
    if absent:
        found.append(
            f"{len(absent)} of {len(frames)} frames with truth are not in the run and count as "
            f"missed, frame {absent[0]} first"
        )
    unknown = sorted(set(predictions) - set(truth))
    if unknown:
        found.append(
            f"{len(unknown)} frames of the run have no truth and do not count, "
            f"frame {unknown[0]} first"
        )
    return found
