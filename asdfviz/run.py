"""The only loop over frames: runs a method on a sequence and times it.

Truth reaches a method only here, only as the pose of the first frame, and only if its spec asks.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from asdfviz import __version__
from asdfviz.data.hashes import assembly_sha256, file_sha256, sequence_sha256
from asdfviz.data.truth import fitting_errors
from asdfviz.datatypes import (
    Assembly,
    Frame,
    FramePrediction,
    FrameTruth,
    PoseEstimate,
    Run,
    Sequence,
    StateEstimate,
)
from asdfviz.errors import AsdfvizError, InputError, MethodError, SequenceError, Stopped
from asdfviz.methods.answers import check_answer
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.first_pose import (
    CropPoseConfig,
    FirstPose,
    chosen_first_pose,
    crop_weights_path,
)
from asdfviz.methods.network import NetworkConfig, masks_path, weights_path
from asdfviz.methods.registry import build_method
from asdfviz.methods.spec import Method, MethodSpec
from asdfviz.methods.state_looks import asked_state_network
from asdfviz.methods.yolov8pose import Yolov8PoseConfig
from asdfviz.track.viewpoint_cache import load_viewpoint_models


def run(
    spec: MethodSpec,
    sequence: Sequence,
    *,
    config: object | None = None,
    progress: Callable[[int, int, FramePrediction], None] | None = None,
    stop: Callable[[], bool] | None = None,
    keep: Callable[[Run], None] | None = None,
    prepare: Callable[[int, int], None] | None = None,
    first: int | None = None,
) -> Run:
    """Run a method over the frames of a sequence; over those before it was stopped.

    Args:
        spec: the method.
        sequence: RGB-D frames; frames without depth are fine where the method is.
        config: the method's config; None means its defaults.
        progress: called after every frame with frames done, frames in all, and the prediction.
        stop: asked before every frame; True ends the run early with what there is.
        keep: called with the run so far where a later frame fails, before the error is raised.
        prepare: called with (views done, views) while viewpoint models are made, the first time.
        first: only so many frames, from the first on; None for all.

    Raises:
        InputError: `first` is below 1.
        SequenceError: the sequence has no assembly, no frames, or no truth where it is needed.
        MethodError: the method failed or said something impossible; with the frame.
    """
    assembly = _known_assembly(sequence)
    wanted = frames_wanted(sequence, first)
    config = spec.config() if config is None else config
    method = build_method(spec, config)  # refuses a config of another class
    initial = _initial(sequence, assembly) if spec.initial == "first_frame_truth" else None
    predictions: list[FramePrediction] = []
    hashes = input_hashes(sequence, assembly, config)  # what lies there later may be something else

    def so_far() -> Run:
        return _run_of(predictions, spec, sequence, assembly, config, hashes)

    if spec.viewpoints:
        try:
            load_viewpoint_models(assembly, progress=prepare, stop=stop)
        except Stopped:
            return so_far()
    _guarded_reset(method, spec, sequence, assembly, initial)
    try:
        for place in range(wanted):
            if stop is not None and stop():
                break
            prediction = _timed_step(method, spec, sequence[place], assembly)
            predictions.append(prediction)
            if progress is not None:
                progress(len(predictions), wanted, prediction)
    except BaseException:  # an impatient Ctrl+C as well: hours of frames are worth a file
        if keep is not None and predictions:
            keep(so_far())
        raise
    return so_far()


def frames_wanted(sequence: Sequence, first: int | None) -> int:
    """How many frames to run on: the first so many, None for all.

    Raises:
        InputError: `first` is below 1.
    """
    if first is not None and first < 1:
        raise InputError(f"{first} frames are nothing to run on: ask for 1 or more")
    return len(sequence) if first is None else min(first, len(sequence))


def _run_of(
    predictions: list[FramePrediction],
    spec: MethodSpec,
    sequence: Sequence,
    assembly: Assembly,
    config: object,
    hashes: Mapping[str, str],
) -> Run:
    return Run(
        method=spec.name,
        config=dataclasses.asdict(resolved_config(config, assembly)),
        sequence=str(Path(sequence.path).resolve()),
        assembly=str(Path(assembly.path).resolve()),
        version=__version__,
        predictions=tuple(predictions),
        hashes=hashes,
        initial=spec.initial,
        says_states="state" in spec.predicts,
    )


def _known_assembly(sequence: Sequence) -> Assembly:
    assembly = sequence.assembly
    if assembly is None:
        named = getattr(sequence, "missing_assembly", None)
        found = (
            f"names the assembly '{named}', not found" if named else "does not name its assembly"
        )
        raise SequenceError(f"{sequence.path} {found}: say which with --assembly PATH")
    if not len(sequence):
        raise SequenceError(f"{sequence.path} has no frames")
    return assembly


def input_hashes(sequence: Sequence, assembly: Assembly, config: object) -> dict[str, str]:
    """SHA-256 of the assembly with its meshes, of the weights of networks that run, of the frames."""
    hashes = {
        "assembly": assembly_sha256(assembly),
        "sequence": sequence_sha256(Path(sequence.path)),
    }
    for network in _networks(config).values():
        weights = weights_path(network, assembly)
        if weights.is_file():
            hashes["weights"] = file_sha256(weights)
    crops = getattr(config, "crops", None)
    if isinstance(crops, CropPoseConfig) and _first_pose(config, assembly) == "hypotheses":
        weights = crop_weights_path(crops, assembly)
        if weights.is_file():
            hashes["crops"] = file_sha256(weights)
    states = _state_network(config, assembly)
    if states is not None and states.is_file():
        hashes["states"] = file_sha256(states)
    masks = _masks(config, assembly)
    if masks is not None and masks.is_file():
        hashes["masks"] = file_sha256(masks)
    return hashes


def _first_pose(config: Any, assembly: Assembly) -> FirstPose:
    return chosen_first_pose(config.first_pose, config.crops, assembly)


def _initial(sequence: Sequence, assembly: Assembly) -> FramePrediction:
    truth = sequence.truth(0)
    if truth is None:
        raise SequenceError(
            f"{sequence.path} has no truth for its first frame, which this method starts from"
        )
    poses = {
        name: PoseEstimate(name, T_camera_part, 1.0, "truth")
        for name, T_camera_part in truth.T_camera_part.items()
        if name in assembly.parts
    }
    return FramePrediction(truth.frame_index, poses, _true_state(truth, assembly))


def _true_state(truth: FrameTruth, assembly: Assembly) -> StateEstimate | None:
    if truth.state is None:
        return None
    index = next((error.index for error in fitting_errors(truth, assembly)), truth.state)
    probabilities = np.zeros(len(assembly.states))
    probabilities[index] = 1.0
    return StateEstimate(probabilities)


def _guarded_reset(
    method: Method,
    spec: MethodSpec,
    sequence: Sequence,
    assembly: Assembly,
    initial: FramePrediction | None,
) -> None:
    try:
        method.reset(assembly, sequence.camera, initial)
    except AsdfvizError:
        raise
    except (Exception, SystemExit) as error:  # a plug-in must not end the program
        raise MethodError(
            f"method '{spec.name}' failed to start: {type(error).__name__}: {error}"
        ) from error


def _timed_step(
    method: Method, spec: MethodSpec, frame: Frame, assembly: Assembly
) -> FramePrediction:
    start = time.perf_counter()
    try:
        answer = method.step(frame)
    except AsdfvizError:
        raise
    except (Exception, SystemExit) as error:
        raise MethodError(
            f"method '{spec.name}' failed in frame {frame.index}: {type(error).__name__}: {error}"
        ) from error
    seconds = time.perf_counter() - start
    prediction = check_answer(answer, assembly, frame_index=frame.index, method=spec.name)
    return dataclasses.replace(prediction, runtime={**prediction.runtime, "total": seconds})


def resolved_config(config: Any, assembly: Assembly) -> Any:
    """Fill default weights and first poses into a method's config, so that the run says what it used."""
    absolute: dict[str, object] = {
        name: dataclasses.replace(network, weights=weights_path(network, assembly))
        for name, network in _networks(config).items()
    }
    crops = getattr(config, "crops", None)
    if isinstance(crops, CropPoseConfig):
        absolute["first_pose"] = _first_pose(config, assembly)
        if absolute["first_pose"] == "hypotheses":
            weights = crop_weights_path(crops, assembly)
            crops = dataclasses.replace(crops, weights=weights)
        states = _state_network(config, assembly)
        if states is not None:
            absolute["state_looks"] = "places"
            crops = dataclasses.replace(crops, state_weights=states)
        absolute["crops"] = crops
    masks = _masks(config, assembly)
    if masks is not None:
        absolute["masks"] = masks
    return dataclasses.replace(config, **absolute) if absolute else config


def _state_network(config: Any, assembly: Assembly) -> Path | None:
    """The weights of the state network, if one runs."""
    if not isinstance(config, Yolov8PoseConfig | AsdfConfig):
        return None
    first_pose = _first_pose(config, assembly)
    return asked_state_network(config.state_looks, first_pose, config.crops, assembly)


def _masks(config: Any, assembly: Assembly) -> Path | None:
    """The weights of the mask branch, if one runs."""
    if not isinstance(config, Yolov8PoseConfig) or config.refinement != "segmentation":
        return None
    return masks_path(config.masks, config.detector, assembly)


def _networks(config: Any) -> dict[str, NetworkConfig]:
    """The config's fields that hold a network."""
    named = ((f.name, getattr(config, f.name)) for f in dataclasses.fields(config))
    return {name: value for name, value in named if isinstance(value, NetworkConfig)}
