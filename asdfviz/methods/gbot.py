"""GBOT: parts tracked together, joined as the assembly's steps have them (Li et al., IEEE VR 2024).

The state graph is a line: the next step is reached when the parts that it adds or moves come near enough
to where it has them, and there is no way back. From then on they hang on the base with the freedoms of their
joints. Unless it runs as published, a lost part is sought where the coming steps have it, and a step
whose parts are lost is passed over once those of a later one are in place.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import (
    Assembly,
    Camera,
    Frame,
    FramePrediction,
    PoseEstimate,
    StateEstimate,
)
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import inverse
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.step_places import StepPlaces, StepPlacesConfig, moved_parts
from asdfviz.methods.timing import StageTimer
from asdfviz.methods.tolerances import TRACKED_PLACES
from asdfviz.methods.tracking import Following, PartTrackerConfig
from asdfviz.state.base_turns import BaseTurns
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
    places: StepPlacesConfig = field(default_factory=StepPlacesConfig)
    """Whether lost parts are sought in the places of the coming steps; as published, they are not."""
    passed_over: int = 5
    """Frames for which the parts of a later step must be in place before one is passed over whose parts
    are lost; as published, none is."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if self.passed_over < 1:
            raise MethodError(f"passed_over is {self.passed_over}, give 1 or more")

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
        self._places: StepPlaces | None = None
        self._turns: BaseTurns | None = None
        self._step = 0
        self._later: dict[int, int] = {}
        """Frames for which the parts of a later step have been in place."""
        self._moved: frozenset[str] = frozenset()
        """Joined parts that were seen where the next step moves them."""

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the parts' viewpoint models and keep the start for the first frame.

        Raises:
            MethodError: there is no start.
        """
        if initial is None:
            raise MethodError("gbot needs the poses of the first frame to start from")
        self._initial = initial
        self._assembly = assembly
        within = self._config.joins_within
        self._places = StepPlaces(assembly, within, config=self._config.places)
        self._turns = BaseTurns(assembly, config=TRACKED_PLACES)
        self._step = 0
        self._later.clear()
        self._moved = frozenset()
        if initial.state is not None:
            self._step = assembly.states[initial.state.index].completed
        self._following = Following(assembly, camera, self._config)

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
            self._turn_base(frame, following, assembly)
            reached = self._reached(following, assembly)
            if reached != self._step:
                self._step = reached
                self._later.clear()
                self._moved = frozenset()
                self.rejoin(tracker, assembly)
        self.before_tracking(following, frame, timed)
        held = [n for n in self.attached if n != assembly.base]
        linked = held if assembly.base in tracker.names else []
        poses = following.update(frame, timed, held=linked, base=assembly.base)
        with timed("state"):
            self._sought(frame, following, poses)
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

    def _turn_base(self, frame: Frame, following: Following, assembly: Assembly) -> None:
        """Turn a base that looks the same turned as the parts that are tracked tell it."""
        tracker, base = following.tracker, assembly.base
        tracked = {
            name: PoseEstimate(name, T, 1.0, "tracked")
            for name, T in tracker.poses.items()
            if name not in following.lost
        }
        if self._turns is None or base not in tracked:
            return
        T_camera_base = self._turns.told(tracked)[base].T_camera_part
        if not np.allclose(T_camera_base, tracked[base].T_camera_part):
            tracker.release()  # or what hangs on it would turn with it
            tracker.replace(frame, {base: T_camera_base})
            following.placed([base])
            self.rejoin(tracker, assembly)

    def _reached(self, following: Following, assembly: Assembly) -> int:
        """The step that is reached now: the present one, the next, or a later one."""
        steps, tracker, now = assembly.steps, following.tracker, self._step
        if assembly.base not in tracker.names:
            return now
        tracked = set(tracker.names) - following.lost
        for later in range(now + 1, len(steps)):
            before, state = steps[later - 1], steps[later]
            new = set(state.attached) - set(before.attached) | moved_parts(before, state)
            missing = {name for name in new if not self._in_place(name, later, tracker)}
            if not missing and later == now + 1:
                return later
            if self._config.published or assembly.base in following.lost:
                return now
            if not missing and new.isdisjoint(following.lost):
                self._later[later] = self._later.get(later, 0) + 1
                return later if self._later[later] >= self._config.passed_over else now
            self._later.pop(later, None)
            if not missing.isdisjoint(tracked):
                return now
        return now

    def _in_place(self, name: str, step: int, tracker: Tracker) -> bool:
        """Whether a part is tracked, and where a step has it."""
        if self._places is None or self._assembly is None or name not in tracker.names:
            return False
        poses, steps = tracker.poses, self._assembly.steps
        T_base_part = inverse(poses[self._assembly.base]) @ poses[name]
        if name not in steps[step - 1].attached:
            return self._places.is_in_place(name, T_base_part, steps[step])
        is_seen = step == self._step + 1 and name in self._moved
        return is_seen or self._places.is_moved(name, T_base_part, step)

    def _sought(self, frame: Frame, following: Following, poses: dict[str, PoseEstimate]) -> None:
        """Put lost parts where they are seen joined, note which joined ones are seen to have been moved."""
        if self._places is None or self._config.published:
            return
        tracker = following.tracker
        found = self._places.step(frame, tracker, poses, following.lost, self._step)
        self._moved = frozenset(found).intersection(self.attached)
        found = {name: trial for name, trial in found.items() if name not in self._moved}
        tracker.replace(frame, {name: trial.T_camera_part for name, trial in found.items()})
        following.placed(list(found))
        for name, trial in found.items():
            poses[name] = PoseEstimate(name, trial.T_camera_part, trial.confidence, "tracked")


SPEC = MethodSpec(
    name="gbot",
    summary="Tracks parts from the first frame's truth, joined along the steps (GBOT)",
    config=GbotConfig,
    factory="asdfviz.methods.gbot:Gbot",
    initial="first_frame_truth",
    viewpoints=True,
)
