"""What the tracking methods share: models of the parts, the start from truth, parts one by one.

A part is absent where the first frame's truth does not have it, and while the tracker's own
judgement says that it is lost. Settings are ours for hand-sized parts unless `published` is asked.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from typing import ClassVar

from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.methods.following import FollowConfig, Follower
from asdfviz.methods.timing import StageTimer
from asdfviz.track.bodies import Body
from asdfviz.track.presets import FOLLOWED, GBOT, TrackerConfig
from asdfviz.track.tracker import Tracker
from asdfviz.track.viewpoint_cache import load_viewpoint_models


@dataclass(frozen=True)
class PartTrackerConfig:
    """Options of a method that tracks every part alone."""

    tracker: TrackerConfig = FOLLOWED
    """What evidence is used, and how."""
    follow: FollowConfig = field(default_factory=FollowConfig)
    """How parts are followed that move fast or are hidden."""
    published: bool = False
    """Track with the settings that were published, and follow parts by the tracker alone."""
    report_lost: bool = False
    """Also give the poses of parts that are lost. Paper: yes, it knows no loss."""
    PUBLISHED: ClassVar[TrackerConfig] = GBOT
    """The settings that `published` means."""

    @property
    def settings(self) -> TrackerConfig:
        """What the tracker is to use."""
        return self.PUBLISHED if self.published else self.tracker


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


class Following:
    """A tracker that was started from truth, with a follower unless it runs as published."""

    def __init__(self, assembly: Assembly, camera: Camera, config: PartTrackerConfig) -> None:
        """Load the parts' viewpoint models."""
        self.bodies = load_bodies(assembly)
        self.tracker = Tracker(self.bodies, camera, config.settings)
        self.lost: frozenset[str] = frozenset()
        """Parts whose pose was too unsure after the last frame."""
        self._assembly = assembly
        self._config = config
        self._follower: Follower | None = None

    def start(self, frame: Frame, initial: FramePrediction) -> None:
        """Begin at the poses that a run was handed.

        Raises:
            MethodError: there are none.
        """
        if not initial.poses:
            raise MethodError("the truth of the first frame has no poses to start from")
        poses = {name: pose.T_camera_part for name, pose in initial.poses.items()}
        self.tracker.start(frame, poses)
        if not self._config.published:
            self._follower = Follower(
                self.tracker, self.bodies, self._assembly, self._config.follow
            )

    def placed(self, names: Collection[str]) -> None:
        """Somebody took these parts in or put them elsewhere."""
        if self._follower is not None:
            self._follower.place(names)

    def update(
        self, frame: Frame, timed: StageTimer, *, held: Collection[str] = (), base: str = ""
    ) -> dict[str, PoseEstimate]:
        """Move all parts to the frame; poses scored by confidence, lost ones only if wanted.

        `held` parts hang on `base`.
        """
        tracker = self.tracker
        with timed("track"):
            if self._follower is not None:
                sure = self._follower.update(frame, held=held, base=base)
            else:
                tracker.update(frame)
                sure = tracker.confidence(frame)
        least = tracker.config.confidence.lost_below
        self.lost = frozenset(name for name, value in sure.items() if value < least)
        return {
            name: PoseEstimate(name, T_camera_part, sure[name], "tracked")
            for name, T_camera_part in tracker.poses.items()
            if self._config.report_lost or name not in self.lost
        }


class PartTracker:
    """Carries every part of the first frame's truth through the sequence, each on its own."""

    def __init__(self, config: PartTrackerConfig) -> None:
        self._config = config
        self._following: Following | None = None
        self._initial: FramePrediction | None = None

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the parts' viewpoint models and keep the start for the first frame.

        Raises:
            MethodError: there is no start.
        """
        if initial is None:
            raise MethodError("a tracker needs the poses of the first frame to start from")
        self._initial = initial
        self._following = Following(assembly, camera, self._config)

    def step(self, frame: Frame) -> FramePrediction:
        """Move all parts to the next frame."""
        if self._following is None:
            raise MethodError("reset() must come before step()")
        timed = StageTimer()
        if self._initial is not None:
            with timed("track"):
                self._following.start(frame, self._initial)
            self._initial = None
        poses = self._following.update(frame, timed)
        return FramePrediction(frame.index, poses, None, runtime=timed.seconds)
