"""How well poses agree with what the camera measured: figures that need no truth.

Every part is drawn where a run has it; what depth the camera read there tells how far the drawn
surface is off along the line of sight. This says nothing of a pose that slides along its own
surface, and a run that finds little may agree well: the figures go with how much was found.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float32

from asdfviz.data.run_frames import shared_frames
from asdfviz.datatypes import Assembly, Frame, FramePrediction, Run, Sequence
from asdfviz.errors import SequenceError, Stopped
from asdfviz.evaluate.health_shift import MOST_SHIFT_FRAMES, DepthShift, measure_shift, spread
from asdfviz.evaluate.protocols import median, percentile
from asdfviz.evaluate.records import predictions_by_frame
from asdfviz.evaluate.tables import number
from asdfviz.geometry.shapes import Depth, Ids, Rgb
from asdfviz.render.overlay import draw_outlines
from asdfviz.render.renderer import Renderer
from asdfviz.render.visibility import OCCLUSION_TOLERANCE

NEAR = 0.005
"""A surface within this of its readings agrees, metres."""
MOST_PIXELS = 4000
"""Of a part in a frame; more are thinned evenly."""
SCALE = 0.020
"""Readings this far behind a part are drawn full red, metres; before it, full blue."""
Gaps = Float32[np.ndarray, "_"]


@dataclass(frozen=True, slots=True, eq=False)
class FrameAgreement:
    """One frame: what was read at its parts, and the median of that."""

    frame_index: int
    residual_mm: float
    rgb: Rgb
    ids: Ids
    gaps: Float32[np.ndarray, "h w"]
    """Measured minus drawn depth, metres; NaN where nothing was measured."""
    count: int
    """Of parts that are drawn."""

    @property
    def picture(self) -> Rgb:
        """The frame with red where the camera saw deeper than the part, blue where nearer, white between."""
        known = (self.ids >= 0) & np.isfinite(self.gaps)
        off = np.clip(self.gaps[known] / SCALE, -1, 1)
        paint = np.stack([1 - np.clip(-off, 0, 1), 1 - np.abs(off), 1 - np.clip(off, 0, 1)], axis=1)
        result = self.rgb.copy()
        result[known] = np.rint(0.35 * self.rgb[known] + 0.65 * 255 * paint).astype(np.uint8)
        return draw_outlines(result, self.ids, [np.full(3, 255)] * self.count, width_px=1)


@dataclass(slots=True)
class _Readings:
    """What was measured at one part, frame by frame: measured minus drawn depth, metres."""

    gaps: list[Gaps] = field(default_factory=list[Gaps])
    drawn: int = 0
    read: int = 0
    visible: int = 0

    def figures(self) -> dict[str, Any]:
        gaps = np.concatenate([np.zeros(0, np.float32), *self.gaps]) * 1e3
        share = 100.0 / max(self.read, 1)
        return {
            "frames": len(self.gaps),
            "read": 100.0 * self.read / max(self.drawn, 1),
            "visible": self.visible * share if self.read else None,
            "residual_mm_median": median(np.abs(gaps)),
            "residual_mm_p90": percentile(np.abs(gaps), 90.0),
            "deeper_mm_median": median(gaps),
            "near": 100.0 * float(np.mean(np.abs(gaps) < 1e3 * NEAR)) if len(gaps) else None,
        }


def agreement(
    run: Run,
    sequence: Sequence,
    assembly: Assembly,
    *,
    register: bool = True,
    seen: Callable[[FrameAgreement], None] | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[str, Any]:
    """Compare every pose of a run with the depth that was measured; mm and percent, None if unknown.

    Args:
        run: what a method said.
        sequence: its frames, with depth.
        assembly: its parts.
        register: move depth onto colour first, where its edges say that it lies beside.
        seen: given every frame's readings.
        progress: called with (frames done, frames).
        stop: asked before every frame.

    Raises:
        RunError: the run is of another assembly, or holds no frame of the sequence.
        SequenceError: it holds none that has depth.
        Stopped: by the user.
    """
    predictions = predictions_by_frame(run, assembly)
    places = _places(run, sequence)
    shift = _shift(sequence, places) if register else None
    parts = {name: _Readings() for name in assembly.parts}
    with_depth = 0
    with Renderer(sequence.camera.width, sequence.camera.height) as renderer:
        for done, place in enumerate(places):
            if stop is not None and stop():
                raise Stopped
            frame = sequence[place]
            if frame.depth is not None:
                with_depth += 1
                said = predictions[frame.index]
                frame_seen = _take(frame, said, assembly, shift, parts, renderer)
                if seen is not None and frame_seen is not None:
                    seen(frame_seen)
            if progress is not None:
                progress(done + 1, len(places))
    if with_depth == 0:
        raise SequenceError(f"{sequence.path}: no frame of the run has depth to compare it with")
    everything = _Readings(
        [gaps for readings in parts.values() for gaps in readings.gaps],
        *(sum(getattr(r, name) for r in parts.values()) for name in ("drawn", "read", "visible")),
    )
    pooled = everything.figures() | {"frames": with_depth}
    return {
        "method": run.method,
        "sequence": sequence.name,
        "n_frames": with_depth,
        "depth_moved_px": None if shift is None else list(shift.shift_px),
        "depth_scaled": None if shift is None else shift.scale,
        "parts": {name: readings.figures() for name, readings in parts.items()},
        "pooled": pooled,
    }


def _places(run: Run, sequence: Sequence) -> list[int]:
    """Of the frames that the run holds."""
    source = f"the run of '{run.method}'"
    held = set(shared_frames(run, sequence.frame_indices, source=source, other=sequence.path))
    return [i for i, index in enumerate(sequence.frame_indices) if index in held]


def agreement_table(found: Mapping[str, Any]) -> str:
    """One row a part, and one for all pixels together; shares in percent, the rest mm."""
    rows = [["part", "frames", "read", "visible", "residual", "p90", "deeper", "< 5 mm"]]
    for name, figures in (*found["parts"].items(), ("all pixels", found["pooled"])):
        keys = ("read", "visible", "residual_mm_median", "residual_mm_p90", "deeper_mm_median")
        rows.append(
            [name, str(figures["frames"]), *(number(figures[key]) for key in (*keys, "near"))]
        )
    widest = max(len(name) for name, *_ in rows)
    lines = [f"{name:<{widest}}" + "".join(f"{c:>10}" for c in cells) for name, *cells in rows]
    moved = found["depth_moved_px"]
    if moved is not None:
        x, y = moved
        lines.append(
            f"depth was moved by ({x:.1f}, {y:.1f}) px and scaled by {found['depth_scaled']:.3f} "
            "to lie on colour; --no-register leaves it"
        )
    return "\n".join(lines)


def _take(
    frame: Frame,
    prediction: FramePrediction,
    assembly: Assembly,
    shift: DepthShift | None,
    parts: Mapping[str, _Readings],
    renderer: Renderer,
) -> FrameAgreement | None:
    """Add one frame's readings to the parts'; None where no part was drawn on one."""
    assert frame.depth is not None
    names = list(prediction.poses)
    if not names:
        return None
    meshes = [assembly.parts[name].mesh for name in names]
    poses = [prediction.poses[name].T_camera_part for name in names]
    drawn, ids = renderer.depth_and_ids(meshes, poses, frame.camera.K)
    measured = frame.depth if shift is None else _moved(frame.depth, shift, frame)
    gaps = np.where(measured > 0, measured - drawn, np.nan).astype(np.float32)
    for i, name in enumerate(names):
        here = gaps[ids == i]
        read = here[np.isfinite(here)]
        visible = read[read > -OCCLUSION_TOLERANCE]
        readings = parts[name]
        readings.drawn += len(here)
        readings.read += len(read)
        readings.visible += len(visible)
        readings.gaps.append(visible[:: max(1, len(visible) // MOST_PIXELS)])
    at_parts = gaps[(ids >= 0) & (gaps > -OCCLUSION_TOLERANCE)]
    if len(at_parts) == 0:
        return None
    residual = 1e3 * float(np.median(np.abs(at_parts)))
    return FrameAgreement(frame.index, residual, frame.rgb, ids, gaps, len(names))


def _moved(depth: Depth, shift: DepthShift, frame: Frame) -> Depth:
    """Depth where colour has the same edges."""
    center, scale = frame.camera.K[:2, 2], shift.scale
    M = np.column_stack([scale * np.eye(2), (1 - scale) * center + np.array(shift.shift_px)])
    size = (depth.shape[1], depth.shape[0])
    return np.asarray(cv2.warpAffine(depth, M, size, flags=cv2.INTER_NEAREST), np.float32)


def _shift(sequence: Sequence, places: list[int]) -> DepthShift | None:
    """How far depth lies beside colour, if it can be told and is worth a pixel."""
    chosen = [sequence[places[i]] for i in spread(len(places), MOST_SHIFT_FRAMES)]
    found = measure_shift([frame for frame in chosen if frame.depth is not None])
    return None if found is None or found.typical_px < 1.0 else found
