"""What the tracking methods share: models of the parts, the start from truth, parts one by one.

A part is absent where the first frame's truth does not have it, and while the tracker's own
judgement says that it is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.methods.timing import StageTimer
from asdfviz.track.bodies import Body
from asdfviz.track.presets import YCB_ICG, TrackerConfig
from asdfviz.track.tracker import Tracker
from asdfviz.track.viewpoint_cache import load_viewpoint_models


@dataclass(frozen=True)
class PartTrackerConfig:
    """Options of a method that tracks every part alone."""

    tracker: TrackerConfig = YCB_ICG
    """What evidence is used, and how."""
    report_lost: bool = False
    """Also give the poses of parts that are lost. Paper: yes, it knows no loss."""


def load_bodies(
    assembly: Assembly,
    *,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[str, Body]:
    """Every part as the tracker wants it; makes what no cache has, which takes seconds a part.

    `progress` is told (views done, views) where something has to be made.

    Raises:
        Stopped: `stop` said so.
    """
    models = load_viewpoint_models(assembly, progress=progress, stop=stop)
    return {name: Body.of(part, models[name]) for name, part in assembly.parts.items()}


def start_from_truth(tracker: Tracker, frame: Frame, initial: FramePrediction) -> None:
    """Begin at the poses that a run was handed.

    Raises:
        MethodError: there are none.
    """
    if not initial.poses:
        raise MethodError("the truth of the first frame has no poses to start from")
    tracker.start(frame, {name: pose.T_camera_part for name, pose in initial.poses.items()})


def tracked_poses(tracker: Tracker, frame: Frame, *, lost_too: bool) -> dict[str, PoseEstimate]:
    """The tracker's poses after a frame, scored by its confidence."""
    sure = tracker.confidence(frame)
    least = tracker.config.confidence.lost_below
    return {
        name: PoseEstimate(name, T_camera_part, sure[name], "tracked")
        for name, T_camera_part in tracker.poses.items()
        if lost_too or sure[name] >= least
    }


class PartTracker:
    """Carries every part of the first frame's truth through the sequence, each on its own."""

    def __init__(self, config: PartTrackerConfig) -> None:
        self._config = config
        self._tracker: Tracker | None = None
        self._initial: FramePrediction | None = None

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the parts' viewpoint models and keep the start for the first frame.

        Raises:
            MethodError: there is no start.
        """
        if initial is None:
            raise MethodError("a tracker needs the poses of the first frame to start from")
        self._initial = initial
        self._tracker = Tracker(load_bodies(assembly), camera, self._config.tracker)

    def step(self, frame: Frame) -> FramePrediction:
        """Move all parts to the next frame."""
        if self._tracker is None:
            raise MethodError("reset() must come before step()")
        timed = StageTimer()
        with timed("track"):
            if self._initial is not None:
                start_from_truth(self._tracker, frame, self._initial)
                self._initial = None
            self._tracker.update(frame)
        with timed("judge"):
            poses = tracked_poses(self._tracker, frame, lost_too=self._config.report_lost)
        return FramePrediction(frame.index, poses, None, runtime=timed.seconds)
