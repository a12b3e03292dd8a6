"""ASDF, and what pays beyond the paper, frame by frame: same detector, same frames, no tracker.

Poses of `asdf` are registered with the depth image in six degrees of freedom, from several starts
(its own, the frame before, where the state joins the part); parts that the state joins are placed by
the group; the state comes from a hidden Markov model instead of an average. A pose's score is the
probability that it is right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from asdfviz.datatypes import (
    Assembly,
    Camera,
    Frame,
    FramePrediction,
    PoseEstimate,
    StateEstimate,
)
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Scores
from asdfviz.methods.asdf import Asdf, AsdfConfig
from asdfviz.methods.assignment import assign_detections
from asdfviz.methods.first_pose import LooksAtParts
from asdfviz.methods.group_poses import GroupConfig, GroupPoses
from asdfviz.methods.network import Detects
from asdfviz.methods.part_poses import PartShape, part_shapes
from asdfviz.methods.registration import RegistrationConfig, best_registration
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.timing import StageTimer
from asdfviz.state.appearance import appearance_probabilities
from asdfviz.state.relative_pose import relative_pose_probabilities
from asdfviz.state.smoothing import SmoothingConfig, StateFilter


@dataclass(frozen=True)
class AsdfPlusConfig(AsdfConfig):
    """Options of ASDF, which gives first poses, and of what is added."""

    group: GroupConfig = field(default_factory=lambda: GroupConfig(enabled=False))
    """State helps pose inside ASDF: off, since it is done once, after the registration."""
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    """Six degrees of freedom from depth."""
    joined: GroupConfig = field(default_factory=lambda: GroupConfig(enabled=True))
    """State helps pose, after the registration."""
    smoothing: SmoothingConfig = field(default_factory=SmoothingConfig)
    """The hidden Markov model, online."""


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """What stays the same through a sequence."""

    assembly: Assembly
    shapes: dict[str, PartShape]
    states: StateFilter
    group: GroupPoses


class AsdfPlus:
    """ASDF's poses, registered, grouped, and a state that is followed."""

    def __init__(
        self,
        config: AsdfPlusConfig,
        *,
        detector: Detects | None = None,
        looker: LooksAtParts | None = None,
    ) -> None:
        """Keep the config.

        Args:
            config: the options.
            detector: used instead of the configured network.
            looker: used instead of the configured crop network.
        """
        self._config = config
        self._asdf = Asdf(config, detector=detector, looker=looker)
        self._scene: _Scene | None = None
        self._before: Mapping[str, PoseEstimate] = {}

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the networks and forget the sequence before.

        Raises:
            WeightsError: there are no weights for this assembly.
        """
        config = self._config
        self._asdf.reset(assembly, camera, None)
        shapes = part_shapes(assembly, surface_points=config.translation.surface_points)
        self._before = {}
        self._scene = _Scene(
            assembly,
            shapes,
            StateFilter(assembly, config=config.smoothing),
            GroupPoses(assembly, shapes, config=config.joined),
        )

    def step(self, frame: Frame) -> FramePrediction:
        """Poses and state of the next frame."""
        if self._scene is None:
            raise MethodError("asdf_plus: reset() must come before step()")
        config, scene, timed = self._config, self._scene, StageTimer()
        proposed = self._asdf.step(frame)
        with timed("register"):
            poses = self._registered(proposed, frame, scene)
        with timed("follow"):
            looks = appearance_probabilities(
                proposed.detections, scene.assembly, config=config.appearance
            )
            places = relative_pose_probabilities(poses, scene.assembly, config=config.relative_pose)
            state = _estimate(scene.states.step(looks, places), looks, places)
        if config.joined.enabled:
            with timed("group"):
                poses = scene.group.step(poses, state, frame)
        self._before = poses
        runtime = {**proposed.runtime, **timed.seconds}
        return FramePrediction(frame.index, poses, state, proposed.detections, runtime)

    def _registered(
        self, proposed: FramePrediction, frame: Frame, scene: _Scene
    ) -> dict[str, PoseEstimate]:
        """Every pose of ASDF registered; it starts from the frame before as well."""
        boxes = {name: pose.T_camera_part for name, pose in self._before.items()}
        found = assign_detections(proposed.detections, scene.assembly)
        poses: dict[str, PoseEstimate] = {}
        for name, pose in proposed.poses.items():
            starts = [pose.T_camera_part]
            if name in boxes:
                starts.append(boxes[name])
            best = best_registration(
                starts,
                scene.shapes[name],
                frame,
                box_xyxy=found[name].box_xyxy if name in found else None,
                score=pose.score,
                config=self._config.registration,
            )
            stage = "refined" if best.moved else pose.stage
            poses[name] = PoseEstimate(name, best.T_camera_part, best.confidence, stage)
        return poses


def _estimate(
    belief: Scores | None, looks: Scores | None, places: Scores | None
) -> StateEstimate | None:
    if belief is None:
        return None
    terms = {"appearance": looks, "relative_pose": places}
    return StateEstimate(belief, {name: term for name, term in terms.items() if term is not None})


SPEC = MethodSpec(
    name="asdf_plus",
    summary="ASDF with registration in 6 degrees of freedom, group poses and a followed state",
    config=AsdfPlusConfig,
    factory="asdfviz.methods.asdf_plus:AsdfPlus",
)
