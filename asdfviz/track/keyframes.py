"""Carries annotated poses from keyframes to the frames between them, forwards and backwards.

The annotator's engine: a person sets poses in a few frames, the tracker fills in the others. Each
frame between two keyframes is tracked from both sides and the two are blended, the nearer and the
surer side counting for more. A side ends where it has lost the part; a frame that no side reaches
stays without a pose.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Camera, Frame
from asdfviz.errors import InputError, Stopped
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply_to_point, orthonormalized
from asdfviz.track.bodies import Body
from asdfviz.track.presets import FINE, TrackerConfig
from asdfviz.track.tracker import Tracker


@dataclass(frozen=True, slots=True, eq=False)
class CarriedPose:
    """A pose that was tracked to a frame."""

    T_camera_part: Transform
    confidence: float
    """0 to 1; a blend has that of its surer side."""


@dataclass(frozen=True, slots=True)
class CarryConfig:
    """How keyframes are carried."""

    tracker: TrackerConfig = FINE
    patience: int = 3
    """Frames in a row with too little confidence after which a side ends."""
    apart: float = 0.1
    """Sides that differ by more than this share of the part's reach are not blended: the surer
    one counts."""


Redetect: TypeAlias = Callable[[Frame, str], Transform | None]
"""Where a detector sees a part in a frame, T_camera_part, or None."""


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
    """Track one part from its keyframes to all places: `carry_parts` for one."""
    carried = carry_parts(
        frame_at,
        {"part": keyframes},
        bodies={"part": body},
        camera=camera,
        first=first,
        last=last,
        config=config,
        progress=progress,
        stop=stop,
    )
    return carried["part"]


def carry_parts(
    frame_at: Callable[[int], Frame],
    keyframes: Mapping[str, Mapping[int, Transform]],
    *,
    bodies: Mapping[str, Body],
    camera: Camera,
    first: int,
    last: int,
    config: CarryConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
    redetect: Redetect | None = None,
) -> dict[str, dict[int, CarriedPose]]:
    """Track parts from their keyframes to all places from `first` to `last`, both included.

    Args:
        frame_at: gives the frame at a place; asked at most twice for each, once a direction.
        keyframes: T_camera_part by part and place.
        bodies: of those parts, and maybe of others.
        camera: of all frames.
        first: first place.
        last: last place.
        config: how keyframes are carried.
        progress: told (frames tracked, frames to track); one between keyframes, which is tracked
            from both sides, counts by halves.
        stop: asked before every frame.
        redetect: finds parts again that were lost; what it says is believed only if the picture
            fits it.

    Returns:
        Poses by part and place. Places that no side reached are absent, and so are the keyframes
        themselves, which nobody has to guess.

    Raises:
        InputError: no keyframe, or one outside of the range.
        Stopped: `stop` said so.
    """
    config = config or CarryConfig()
    _check(keyframes, first, last)
    places = [place for own in keyframes.values() for place in own]
    sides = range(min(places), last + 1), range(max(places), first - 1, -1)
    sought = frames_to_track(keyframes, first, last)
    steps = sum(place in sought for side in sides for place in side)
    job = _Job(
        frame_at, keyframes, bodies, camera, config, redetect, stop, progress, sought, steps
    )  # fmt: skip
    forward, backward = (_one_side(job, side) for side in sides)
    if progress is not None:
        progress(len(sought), len(sought))
    return {
        name: _merged((forward[name], backward[name]), sorted(own), bodies[name], config)
        for name, own in keyframes.items()
    }


def frames_to_track(
    keyframes: Mapping[str, Mapping[int, Transform]], first: int, last: int
) -> frozenset[int]:
    """The places, of those from `first` to `last`, that are no keyframe of some part."""
    return frozenset(
        place
        for place in range(first, last + 1)
        if any(place not in own for own in keyframes.values())
    )


def _check(keyframes: Mapping[str, Mapping[int, Transform]], first: int, last: int) -> None:
    if not keyframes:
        raise InputError("nothing to carry: set a part's pose in at least one frame")
    for own in keyframes.values():
        if not own:
            raise InputError("nothing to carry: set the part's pose in at least one frame")
        outside = [place for place in own if not first <= place <= last]
        if outside:
            raise InputError(f"keyframe {outside[0]} is outside of frames {first} to {last}")


@dataclass(slots=True, eq=False)
class _Job:
    """What both sides share."""

    frame_at: Callable[[int], Frame]
    keyframes: Mapping[str, Mapping[int, Transform]]
    bodies: Mapping[str, Body]
    camera: Camera
    config: CarryConfig
    redetect: Redetect | None
    stop: Callable[[], bool] | None
    progress: Callable[[int, int], None] | None
    sought: frozenset[int]
    """Places to track."""
    steps: int
    """How often one of them is looked at, both sides together."""
    done: int = 0

    def tell(self, place: int) -> None:
        """Count a frame that was to be tracked."""
        if self.progress is not None and place in self.sought:
            self.done += 1
            self.progress(self.done * len(self.sought) // self.steps, len(self.sought))

    def check_stop(self) -> None:
        """Raise Stopped if that was asked for."""
        if self.stop is not None and self.stop():
            raise Stopped("stopped while keyframes were being carried")


def _one_side(job: _Job, order: range) -> dict[str, dict[int, CarriedPose]]:
    """Track along `order`; each part from its keyframes until it is lost, unsure poses left out."""
    found: dict[str, dict[int, CarriedPose]] = {name: {} for name in job.keyframes}
    tracker = Tracker(job.bodies, job.camera, job.config.tracker)
    unsure: dict[str, int] = {}
    lost: set[str] = set()
    for place in order:
        job.check_stop()
        given = {n: own[place] for n, own in job.keyframes.items() if place in own}
        # Where all parts are lost there is nothing to do, and no frame to read, up to a keyframe.
        if not tracker.names and not given and (not lost or job.redetect is None):
            continue
        frame = job.frame_at(place)
        if tracker.names:
            tracker.update(frame)
        tracker.drop([name for name in given if name in tracker.names])
        tracker.add(frame, given)
        lost -= given.keys()
        unsure |= dict.fromkeys(given, 0)
        for name, sure in tracker.confidence(frame).items():
            if name in given:
                continue
            if sure >= job.config.tracker.confidence.lost_below:
                found[name][place] = CarriedPose(tracker.poses[name], sure)
                unsure[name] = 0
            else:
                unsure[name] += 1
        ended = {n for n in tracker.names if unsure[n] >= job.config.patience}
        tracker.drop(ended)
        lost |= ended
        lost -= _found_again(job, tracker, frame, place, lost, found, unsure)
        job.tell(place)
    return found


def _found_again(
    job: _Job,
    tracker: Tracker,
    frame: Frame,
    place: int,
    lost: Collection[str],
    found: dict[str, dict[int, CarriedPose]],
    unsure: dict[str, int],
) -> set[str]:
    """Ask the detector for lost parts; those whose pose the picture fits are tracked from there."""
    back: set[str] = set()
    for name in (n for n in job.keyframes if n in lost):
        T = None if job.redetect is None else job.redetect(frame, name)
        if T is None:
            continue
        tracker.add(frame, {name: T})
        best = tracker.trials(frame, name, [T])[0]
        if best.confidence < job.config.tracker.confidence.lost_below:
            tracker.drop([name])
            continue
        tracker.replace(frame, {name: best.T_camera_part})
        found[name][place] = CarriedPose(best.T_camera_part, best.confidence)
        unsure[name] = 0
        back.add(name)
    return back


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
        # A part that was found again may be known on both sides beyond its outermost keyframes.
        before = max((p for p in places if p < place), default=None)
        after = min((p for p in places if p > place), default=None)
        share = 0.5
        if before is not None and after is not None:
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
    middle = (1 - weight) * apply_to_point(T_a, centre)
    middle += weight * apply_to_point(T_b, centre)
    T[:3, 3] = middle - T[:3, :3] @ centre
    return T
