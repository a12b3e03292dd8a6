"""Carries annotated poses from keyframes to the frames between them, forwards and backwards.

The annotator's engine: a person sets a pose in a few frames, the tracker fills in the others. Each
frame between two keyframes is tracked from both sides and the two are blended, the nearer and the
surer side counting for more. A side ends where it has lost the part; a frame that no side reaches
stays without a pose.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Camera, Frame
from asdfviz.errors import InputError, Stopped
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import orthonormalized
from asdfviz.track.presets import YCB_ICG, TrackerConfig
from asdfviz.track.tracker import Body, Tracker


@dataclass(frozen=True, slots=True, eq=False)
class CarriedPose:
    """A pose that was tracked to a frame."""

    T_camera_part: Transform
    confidence: float
    """0 to 1; a blend has that of its surer side."""


@dataclass(frozen=True, slots=True)
class CarryConfig:
    """How keyframes are carried."""

    tracker: TrackerConfig = YCB_ICG
    patience: int = 3
    """Frames in a row with too little confidence after which a side ends."""
    apart: float = 0.1
    """Sides that differ by more than this share of the part's reach are not blended: the surer
    one counts."""


def carry_keyframes(
    frame_at: Callable[[int], Frame],
    keyframes: Mapping[int, Transform],
    *,
    body: Body,
    camera: Camera,
    first: int,
    last: int,
    config: CarryConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[int, CarriedPose]:
    """Track one part from its keyframes to all places from `first` to `last`, both included.

    `frame_at` gives the frame at a place, `keyframes` T_camera_part by place. `progress` is told
    (frames tracked, most frames to track). Places that no side reached are absent, and so are the
    keyframes themselves, which nobody has to guess.

    Raises:
        InputError: no keyframe, or one outside of the range.
        Stopped: `stop` said so.
    """
    config = config or CarryConfig()
    if not keyframes:
        raise InputError("nothing to carry: set the part's pose in at least one frame")
    outside = [place for place in keyframes if not first <= place <= last]
    if outside:
        raise InputError(f"keyframe {outside[0]} is outside of frames {first} to {last}")
    places = sorted(keyframes)
    forward = list(zip(places, [*places[1:], last + 1], strict=True))
    backward = list(zip(places, [first - 1, *places[:-1]], strict=True))
    steps = sum(abs(end - begin) - 1 for begin, end in (*forward, *backward))
    done = 0

    def tell() -> None:
        nonlocal done
        if stop is not None and stop():
            raise Stopped("stopped while keyframes were being carried")
        done += 1
        if progress is not None:
            progress(done, steps)

    sides: tuple[dict[int, CarriedPose], dict[int, CarriedPose]] = ({}, {})
    for side, spans in zip(sides, (forward, backward), strict=True):
        for begin, end in spans:
            order = range(begin, end, 1 if end > begin else -1)
            side |= _one_side(frame_at, order, keyframes[begin], body, camera, config, tell)
    if progress is not None:
        progress(steps, steps)
    return _merged(sides, places, body, config)


def _one_side(
    frame_at: Callable[[int], Frame],
    order: range,
    T_camera_part: Transform,
    body: Body,
    camera: Camera,
    config: CarryConfig,
    tell: Callable[[], None],
) -> dict[int, CarriedPose]:
    """Track along `order`, whose first place is the keyframe, until lost; unsure poses left out."""
    found: dict[int, CarriedPose] = {}
    if len(order) < 2:
        return found
    tracker = Tracker({"part": body}, camera, config.tracker)
    tracker.start(frame_at(order[0]), {"part": T_camera_part})
    unsure = 0
    for place in order[1:]:
        frame = frame_at(place)
        T = tracker.update(frame)["part"]
        sure = tracker.confidence(frame)["part"]
        tell()
        if sure >= config.tracker.confidence.lost_below:
            found[place] = CarriedPose(T, sure)
            unsure = 0
            continue
        unsure += 1
        if unsure >= config.patience:
            break
    return found


def _merged(
    sides: tuple[dict[int, CarriedPose], dict[int, CarriedPose]],
    places: list[int],
    body: Body,
    config: CarryConfig,
) -> dict[int, CarriedPose]:
    """Blend both sides where they agree, and take the surer one where they do not."""
    forward, backward = sides
    merged: dict[int, CarriedPose] = {}
    for place in sorted(forward.keys() | backward.keys()):
        a, b = forward.get(place), backward.get(place)
        if a is None or b is None:
            alone = a or b
            if alone is not None:
                merged[place] = alone
            continue
        before = max(p for p in places if p < place)
        after = min(p for p in places if p > place)
        share = (place - before) / (after - before)
        weight = share * b.confidence / (share * b.confidence + (1 - share) * a.confidence)
        corners = body.mesh.vertices
        gap = corners @ (a.T_camera_part - b.T_camera_part)[:3, :3].T
        gap += (a.T_camera_part - b.T_camera_part)[:3, 3]
        reach = float(np.linalg.norm(corners - body.model.centre, axis=1).max())
        if float(np.linalg.norm(gap, axis=1).mean()) > config.apart * reach:
            merged[place] = a if a.confidence >= b.confidence else b
            continue
        T = blended(a.T_camera_part, b.T_camera_part, weight, centre=body.model.centre)
        merged[place] = CarriedPose(T, max(a.confidence, b.confidence))
    return merged


def blended(T_a: Transform, T_b: Transform, weight: float, *, centre: np.ndarray) -> Transform:
    """Pose between two near ones: `weight` of the second, with the part's centre on a line.

    The rotation is the mean of both matrices made orthonormal, which for angles well below 180
    degrees is the interpolation along the shortest turn.
    """
    T = orthonormalized((1 - weight) * T_a + weight * T_b)
    middle = (1 - weight) * (T_a[:3, :3] @ centre + T_a[:3, 3])
    middle += weight * (T_b[:3, :3] @ centre + T_b[:3, 3])
    T[:3, 3] = middle - T[:3, :3] @ centre
    return T
