"""GBOT: parts tracked together, joined as the assembly's steps have them (Li et al., IEEE VR 2024).

The state graph is a line: the next step is reached when its new parts come near enough to where it
has them, and there is no way back. From then on they hang on the base with the freedoms of their
joints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction, StateEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import inverse
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.timing import StageTimer
from asdfviz.methods.tracking import Following, PartTrackerConfig, load_bodies
from asdfviz.state.joints import deviation
from asdfviz.track.tracker import Tracker


@dataclass(frozen=True)
class GbotConfig(PartTrackerConfig):
    """Options of GBOT; steps are taken as its evaluator does."""

    near: float | None = None
    """A part this near to its place in the next step (metres) joins. Default: 0.04 as published (by
    GBOT's evaluator), else 0.03 (as by its demo), since what joins too soon is held where it is not."""
    angle_deg: float | None = None
    """And turned by less than this, degrees; symmetric poses count as the same. Default: 20 as published,
    else 45, since small parts that hardly show how they are turned are tracked that far off."""

    @property
    def joins_within(self) -> tuple[float, float]:
        """`near` (metres) and `angle_deg` (degrees), chosen or by default."""
        near, angle_deg = (0.04, 20.0) if self.published else (0.03, 45.0)
        return (
            near if self.near is None else self.near,
            angle_deg if self.angle_deg is None else self.angle_deg,
        )


class Gbot:
    """Advance the state, track all parts under its links, say both."""

    def __init__(self, config: GbotConfig) -> None:
        self._config = config
        self._assembly: Assembly | None = None
        self._following: Following | None = None
        self._initial: FramePrediction | None = None
        self._step = 0

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the parts' viewpoint models and keep the start for the first frame.

        Raises:
            MethodError: there is no start.
        """
        if initial is None:
            raise MethodError("gbot needs the poses of the first frame to start from")
        self._initial = initial
        self._assembly = assembly
        self._step = 0
        if initial.state is not None:
            self._step = assembly.states[initial.state.index].completed
        self._following = Following(load_bodies(assembly), camera, self._config)

    def step(self, frame: Frame) -> FramePrediction:
        """Poses and state of the next frame."""
        if self._following is None or self._assembly is None:
            raise MethodError("gbot: reset() must come before step()")
        following, assembly, timed = self._following, self._assembly, StageTimer()
        tracker = following.tracker
        with timed("state"):
            if self._initial is not None:
                following.start(frame, self._initial)
                self._initial = None
                self.rejoin(tracker, assembly)
            if self._reached_next(tracker, assembly):
                self._step += 1
                self.rejoin(tracker, assembly)
        self.before_tracking(following, frame, timed)
        held = [n for n in self.attached if n != assembly.base]
        linked = held if assembly.base in tracker.names else []
        poses = following.update(frame, timed, held=linked, base=assembly.base)
        probabilities = np.zeros(len(assembly.states))
        probabilities[assembly.steps[self._step].index] = 1.0
        return FramePrediction(
            frame.index, poses, StateEstimate(probabilities), runtime=timed.seconds
        )

    def before_tracking(self, following: Following, frame: Frame, timed: StageTimer) -> None:
        """Where a method that re-initialises does so; this one does not."""

    @property
    def attached(self) -> tuple[str, ...]:
        """Parts that the present step joins, the base among them."""
        return () if self._assembly is None else self._assembly.steps[self._step].attached

    def rejoin(self, tracker: Tracker, assembly: Assembly) -> None:
        """Link the parts as the present step has them, once more after parts were added."""
        if assembly.base in tracker.names:
            tracker.hold(assembly.steps[self._step], base=assembly.base)

    def _reached_next(self, tracker: Tracker, assembly: Assembly) -> bool:
        """Whether all new parts of the next step are where it has them."""
        if self._step + 1 >= len(assembly.steps):
            return False
        before, following = assembly.steps[self._step], assembly.steps[self._step + 1]
        poses = tracker.poses
        new = [name for name in following.attached if name not in before.attached]
        if assembly.base not in poses or any(name not in poses for name in new):
            return False
        T_base_camera = inverse(poses[assembly.base])
        for name in new:
            part = assembly.parts[name]
            off = deviation(
                T_base_camera @ poses[name],
                following.T_base_part[name],
                center_part=part.middle,
                symmetries=part.symmetries,
                joint=following.joints.get(name),
            )
            if not off.within(*self._config.joins_within):
                return False
        return True


SPEC = MethodSpec(
    name="gbot",
    summary="Tracks parts from the first frame's truth, joined along the steps (GBOT)",
    config=GbotConfig,
    factory="asdfviz.methods.gbot:Gbot",
    initial="first_frame_truth",
    viewpoints=True,
)
