"""How long first poses from crops take here: the crop network alone, and all of it with settling.

Boxes are those that the true poses span, so no detector is asked; where more parts are wanted than a
scene shows, they come again under other names.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from asdfviz.datatypes import Assembly, Detection, Frame, FrameTruth
from asdfviz.datatypes import Sequence as Recording
from asdfviz.detector.crop_classes import class_name
from asdfviz.errors import InputError
from asdfviz.methods.first_pose import CropPoseConfig, CropPoses, load_looker
from asdfviz.methods.registration import projected_box
from asdfviz.pose.table import SunkConfig

AIM_MS = (15.0, 100.0)
"""What the network and all of it may take for nine parts on two cores."""
RUNS = 5
"""Of a frame, the best of which counts."""
SEEN = 0.3
"""Visible share from which a part is looked at."""


@dataclass(frozen=True, slots=True)
class FirstPoseTime:
    """Milliseconds a frame, the best of `RUNS`."""

    parts: int
    frames: int
    network_ms: float
    """Median: cut the crops, run the network, read its answers."""
    whole_ms: float
    """Median: that, and rotations settled by outline and depth."""
    whole_p90_ms: float
    load: float
    """Of the machine in the last minute: above its number of cores, times are too long."""


def some_frames(
    sequence: Recording, truth: Mapping[int, FrameTruth], count: int
) -> list[tuple[Frame, FrameTruth]]:
    """So many frames with their truth, evenly from a whole sequence; all where there are fewer."""
    known = [place for place, index in enumerate(sequence.frame_indices) if index in truth]
    chosen = known[:: max(1, len(known) // max(count, 1))][: max(count, 0)]
    return [(frame, truth[frame.index]) for frame in map(sequence.__getitem__, chosen)]


def measure_first_poses(
    assembly: Assembly,
    shown: Sequence[tuple[Frame, FrameTruth]],
    *,
    parts: int,
    config: CropPoseConfig,
    progress: Callable[[int, int], None] | None = None,
) -> FirstPoseTime:
    """Time first poses of so many parts.

    Args:
        assembly: whose parts the frames show.
        shown: frames with their truth.
        parts: looked at in every frame; what is seen to `SEEN` in turn.
        config: the crop network and how its answers are settled.
        progress: told (frames done, frames).

    Raises:
        InputError: no part is seen in a frame, or the number of parts.
        WeightsError: there is no crop network for this assembly.
    """
    if parts < 1 or not shown:
        raise InputError(f"{parts} parts in {len(shown)} frames: 1 or more of both are needed")
    looker, times = load_looker(config, assembly), list[tuple[float, float]]()
    each = CropPoses.of(assembly, looker, config=config.hypotheses, sunk=SunkConfig())
    for k, (frame, truth) in enumerate(shown):
        crops, found = _repeated(each, frame, truth, parts)
        many = crops.assembly
        boxes = {n: (class_name(many, many.parts[n]), d.box_xyxy) for n, d in found.items()}
        network = partial(looker.look, frame.rgb, frame.camera.K, boxes)
        whole = partial(crops.looked_at, found, frame, use_depth=frame.depth is not None)
        times.append((_best_ms(network), _best_ms(whole)))
        if progress is not None:
            progress(k + 1, len(shown))
    network_ms, whole_ms = np.array(times).T
    return FirstPoseTime(
        parts=parts,
        frames=len(shown),
        network_ms=float(np.median(network_ms)),
        whole_ms=float(np.median(whole_ms)),
        whole_p90_ms=float(np.quantile(whole_ms, 0.9)),
        load=os.getloadavg()[0],
    )


def _best_ms(work: Callable[[], object]) -> float:
    """Of a few runs, as the first has nothing in the caches."""
    times = list[float]()
    for _ in range(RUNS):
        begun = time.perf_counter()
        work()
        times.append(1e3 * (time.perf_counter() - begun))
    return min(times)


def _repeated(
    each: CropPoses, frame: Frame, truth: FrameTruth, count: int
) -> tuple[CropPoses, dict[str, Detection]]:
    """The parts that are seen, as often as it takes, and a box about each."""
    poses = truth.T_camera_part
    seen = [name for name in poses if truth.visible.get(name, 1.0) >= SEEN]
    if not seen:
        raise InputError(
            f"frame {frame.index}: no part has a true pose and is seen to {SEEN:.0%} or more: "
            "give a scene with scene_gt.json"
        )
    names = {f"part {k + 1}": seen[k % len(seen)] for k in range(count)}
    parts = {new: each.assembly.parts[old] for new, old in names.items()}
    many = replace(
        each,
        assembly=replace(each.assembly, parts=parts),
        surfaces={new: each.surfaces[old] for new, old in names.items()},
        middles={new: each.middles[old] for new, old in names.items()},
    )
    nothing = np.zeros((0, 2)), np.zeros(0)
    boxes = {old: projected_box(poses[old], each.surfaces[old].corners, frame) for old in seen}
    return many, {new: Detection(old, boxes[old], *nothing, 1.0) for new, old in names.items()}


def first_pose_table(measured: FirstPoseTime) -> str:
    """What was measured, as text."""
    return "\n".join(
        (
            f"{measured.parts} parts, {measured.frames} frames, ms a frame",
            f"crop network {measured.network_ms:8.1f}",
            f"first poses  {measured.whole_ms:8.1f}   p90 {measured.whole_p90_ms:.1f}",
            f"aims: {AIM_MS[0]:.0f} and {AIM_MS[1]:.0f} ms for nine parts on two cores; load of the "
            f"machine {measured.load:.1f}",
        )
    )
