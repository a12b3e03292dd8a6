"""Average recall of the BOP challenge 2019: VSD, MSSD and MSPD at all their thresholds.

Targets are the parts of which 10 % can be seen; a target without an estimate fails at every
threshold. Twins (`asdfviz.state.twins`) are instances of one object, as there: of its estimates in
a frame the surest ones count, as many as there are targets, and at every threshold each of them, the
surest first, passes the free target that it is nearest to, if it is near enough. As in bop_toolkit's eval_bop19_pose.py the recall is taken over all targets of the sequence
together, so the mean is not that of the parts where they are seen unequally often. Shares in percent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float64

from asdfviz.datatypes import Assembly, Camera, FramePrediction, FrameTruth, Mesh, PoseEstimate
from asdfviz.datatypes import Sequence as FrameSequence
from asdfviz.evaluate.bop_errors import BopModel, bop_model, mspd, mssd, vsd
from asdfviz.evaluate.protocols import VISIBLE, Figures
from asdfviz.evaluate.records import PoseRecord
from asdfviz.geometry.shapes import Depth, Ids, Intrinsics, Transform
from asdfviz.state.twins import twin_groups

SHARES = np.arange(0.05, 0.51, 0.05)
"""Thresholds of MSSD and taus of VSD in diameters, and thresholds of VSD itself."""
PIXELS = np.arange(5.0, 51.0, 5.0)
"""Thresholds of MSPD in pixels of a picture that is 640 wide."""
_BOP_WIDTH = 640

BOP_FIGURES = ("ar_vsd", "ar_mssd", "ar_mspd", "ar_bop")


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What VSD is judged against in one frame, and what hides parts there."""

    camera: Camera
    depth: Depth | None
    """As measured, metres; None where nothing was, so that the truth is rendered instead."""


Views: TypeAlias = Callable[[int], View]
"""The view of a frame by its number."""


def views_of(sequence: FrameSequence) -> Views:
    """The views of a sequence's frames, read when asked for; a frame without images has no depth."""
    places = {index: place for place, index in enumerate(sequence.frame_indices)}

    def view(frame_index: int) -> View:
        place = places.get(frame_index)
        if place is None:
            return View(sequence.camera, None)
        frame = sequence[place]
        return View(frame.camera, frame.depth)

    return view


@runtime_checkable
class DepthDrawer(Protocol):
    """The part of `asdfviz.render.renderer.Renderer` that is used here."""

    def depth_and_ids(
        self, meshes: list[Mesh], Ts_camera_mesh: list[Transform], K: Intrinsics
    ) -> tuple[Depth, Ids]:
        """Return planar depth (metres, 0 = nothing) and which mesh is in front."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class BopRecord:
    """Which thresholds one target passes."""

    part: str
    vsd: Bool[np.ndarray, "taus thresholds"]
    mssd: Bool[np.ndarray, "thresholds"]
    mspd: Bool[np.ndarray, "thresholds"]


@dataclass(frozen=True, slots=True)
class BopRecall:
    """Average recalls by part and over all targets, and how often depth had to be rendered."""

    parts: Mapping[str, Figures]
    mean: Figures
    frames_measured: int
    """Frames in which VSD saw measured depth; frames without any pose need none."""
    frames_rendered: int


def bop_recall(
    records: Iterable[PoseRecord],
    predictions: Mapping[int, FramePrediction],
    truth: Iterable[FrameTruth],
    assembly: Assembly,
    *,
    views: Views,
    draw: Callable[[Camera], DepthDrawer],
) -> BopRecall:
    """Judge every target.

    Args:
        records: truth of every part in every frame that counts.
        predictions: what the run says, by frame number.
        truth: the same frames, to render the scene where its depth was not measured.
        assembly: its parts.
        views: camera and depth of a frame.
        draw: a renderer for a camera's size; asked once a frame.
    """
    frames = {frame.frame_index: frame for frame in truth}
    by_frame: dict[int, list[PoseRecord]] = {}
    for record in records:
        if record.visible >= VISIBLE:
            by_frame.setdefault(record.frame_index, []).append(record)
    models = {name: bop_model(part) for name, part in assembly.parts.items()}
    groups = twin_groups(assembly)
    judged: list[BopRecord] = []
    measured = rendered = 0
    for index, targets in by_frame.items():
        rivals = _rivals(targets, predictions.get(index), groups)
        if not any(estimates for _, estimates in rivals):
            judged += [_failed(target.part) for target in targets]
            continue
        view = views(index)
        drawer = draw(view.camera)
        depth = view.depth
        if depth is not None:
            measured += 1
        else:
            rendered += 1
            depth = _scene_depth(frames[index], assembly, view.camera, drawer)
        for own, estimates in rivals:
            judged += _judge(own, estimates, models[own[0].part], view.camera, depth, drawer)
    parts = {name: _average([r for r in judged if r.part == name]) for name in assembly.parts}
    return BopRecall(parts, _average(judged), measured, rendered)


def _rivals(
    targets: Sequence[PoseRecord],
    prediction: FramePrediction | None,
    groups: Sequence[Sequence[str]],
) -> list[tuple[list[PoseRecord], list[PoseEstimate]]]:
    """The targets of each object with its estimates, the surest first and no more than targets."""
    poses: Mapping[str, PoseEstimate] = {} if prediction is None else prediction.poses
    found: list[tuple[list[PoseRecord], list[PoseEstimate]]] = []
    for names in groups:
        own = [target for target in targets if target.part in names]
        estimates = sorted((poses[n] for n in names if n in poses), key=lambda pose: -pose.score)
        if own:
            found.append((own, estimates[: len(own)]))
    return found


def _judge(
    targets: Sequence[PoseRecord],
    estimates: Sequence[PoseEstimate],
    model: BopModel,
    camera: Camera,
    depth: Depth,
    drawer: DepthDrawer,
) -> list[BopRecord]:
    """The targets of one object in one frame."""
    if not estimates:
        return [_failed(target.part) for target in targets]
    mesh, K, diameter = model.part.mesh, camera.K, model.part.diameter
    Ts_truth = [target.T_camera_truth for target in targets]
    Ts_estimate = [estimate.T_camera_part for estimate in estimates]
    drawn_truth, drawn_estimate = (
        [drawer.depth_and_ids([mesh], [T], K)[0] for T in Ts] for Ts in (Ts_truth, Ts_estimate)
    )
    seen = [
        [vsd(e, t, depth, K, diameter=diameter, taus=SHARES) for t in drawn_truth]
        for e in drawn_estimate
    ]
    in_space = [[mssd(e, t, model) / diameter for t in Ts_truth] for e in Ts_estimate]
    in_picture = [
        [mspd(e, t, model, K=K) * _BOP_WIDTH / camera.width for t in Ts_truth] for e in Ts_estimate
    ]
    by_tau = np.moveaxis(np.array(seen), 2, 0)
    vsd_passed = np.array([passed(errors, SHARES) for errors in by_tau])
    mssd_passed = passed(np.array(in_space), SHARES)
    mspd_passed = passed(np.array(in_picture), PIXELS)
    return [
        BopRecord(target.part, vsd_passed[:, i], mssd_passed[i], mspd_passed[i])
        for i, target in enumerate(targets)
    ]


def passed(
    errors: Float64[np.ndarray, "estimates targets"], thresholds: Float64[np.ndarray, "thresholds"]
) -> Bool[np.ndarray, "targets thresholds"]:
    """Which targets are found at which threshold: bop_toolkit's greedy matching, score by score.

    Args:
        errors: of every estimate, the surest first, against every target.
        thresholds: an error must be smaller.
    """
    found = np.zeros((errors.shape[1], len(thresholds)), dtype=bool)
    for place, threshold in enumerate(thresholds):
        free = np.ones(errors.shape[1], dtype=bool)
        for row in errors:
            open_errors = np.where(free, row, np.inf)
            nearest = int(open_errors.argmin())
            if open_errors[nearest] < threshold:
                free[nearest] = False
        found[:, place] = ~free
    return found


def _failed(part: str) -> BopRecord:
    count = len(SHARES)
    nothing = np.zeros(count, dtype=bool)
    return BopRecord(part, np.zeros((count, count), dtype=bool), nothing, nothing)


def _average(records: list[BopRecord]) -> Figures:
    if not records:
        return dict.fromkeys(BOP_FIGURES)
    shares: Float64[np.ndarray, "3"] = 100.0 * np.mean(
        [[r.vsd.mean(), r.mssd.mean(), r.mspd.mean()] for r in records], axis=0
    )
    return dict(zip(BOP_FIGURES, [*map(float, shares), float(shares.mean())], strict=True))


def _scene_depth(
    frame: FrameTruth, assembly: Assembly, camera: Camera, drawer: DepthDrawer
) -> Depth:
    """The true parts as a perfect depth camera would see them."""
    names = [name for name in frame.T_camera_part if name in assembly.parts]
    meshes = [assembly.parts[name].mesh for name in names]
    return drawer.depth_and_ids(meshes, [frame.T_camera_part[n] for n in names], camera.K)[0]
