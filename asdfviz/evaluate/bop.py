"""Average recall of the BOP challenge 2019: VSD, MSSD and MSPD at all their thresholds.

Targets are the parts of which 10 % can be seen; one estimate a part, a missing one fails at every
threshold. As in bop_toolkit's eval_bop19_pose.py the recall is taken over all targets of the sequence
together, so the mean is not that of the parts where they are seen unequally often. Shares in percent.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float64

from asdfviz.datatypes import Assembly, Camera, FrameTruth, Mesh
from asdfviz.evaluate.bop_errors import BopModel, bop_model, mspd, mssd, vsd
from asdfviz.evaluate.protocols import VISIBLE, Figures
from asdfviz.evaluate.records import PoseRecord
from asdfviz.geometry.shapes import Depth, Ids, Intrinsics, Transform

SHARES = np.arange(0.05, 0.51, 0.05)
"""Thresholds of MSSD and taus of VSD in diameters, and thresholds of VSD itself."""
PIXELS = np.arange(5.0, 51.0, 5.0)
"""Thresholds of MSPD in pixels of a picture that is 640 wide."""
_BOP_WIDTH = 640

BOP_FIGURES = ("ar_vsd", "ar_mssd", "ar_mspd", "ar_bop")


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What VSD is judged against in one frame."""

    camera: Camera
    depth: Depth | None
    """As measured, metres; None where nothing was, so that the truth is rendered instead."""


Views: TypeAlias = Callable[[int], View]
"""The view of a frame by its number."""


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
    truth: Iterable[FrameTruth],
    assembly: Assembly,
    *,
    views: Views,
    draw: Callable[[Camera], DepthDrawer],
) -> BopRecall:
    """Judge every target.

    Args:
        records: truth and estimate of every part in every frame that counts.
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
    judged: list[BopRecord] = []
    measured = rendered = 0
    for index, targets in by_frame.items():
        if all(target.T_camera_estimate is None for target in targets):
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
        judged += [_judge(t, models[t.part], view.camera, depth, drawer) for t in targets]
    parts = {name: _average([r for r in judged if r.part == name]) for name in assembly.parts}
    return BopRecall(parts, _average(judged), measured, rendered)


def _judge(
    target: PoseRecord, model: BopModel, camera: Camera, depth: Depth, drawer: DepthDrawer
) -> BopRecord:
    T_camera_estimate, T_camera_truth = target.T_camera_estimate, target.T_camera_truth
    if T_camera_estimate is None:
        return _failed(target.part)
    mesh, K = model.part.mesh, camera.K
    depth_estimate, depth_truth = (
        drawer.depth_and_ids([mesh], [T], K)[0] for T in (T_camera_estimate, T_camera_truth)
    )
    diameter = model.part.diameter
    seen = vsd(depth_estimate, depth_truth, depth, K, diameter=diameter, taus=SHARES)
    in_space = mssd(T_camera_estimate, T_camera_truth, model) / diameter
    in_picture = mspd(T_camera_estimate, T_camera_truth, model, K=K)
    return BopRecord(
        part=target.part,
        vsd=seen[:, None] < SHARES[None, :],
        mssd=in_space < SHARES,
        mspd=in_picture * _BOP_WIDTH / camera.width < PIXELS,
    )


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
