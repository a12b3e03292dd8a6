"""GBOT with re-initialisation: every tenth frame a detector's poses correct the tracker's.

The published code compares an angle with itself where it asks whether the tracker's pose is near
enough to be kept, so that it always takes the detector's. What it means is done here; `faithful`
does what it does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction, Part
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Box, Transform
from asdfviz.methods.assignment import assign_detections
from asdfviz.methods.gbot import Gbot, GbotConfig
from asdfviz.methods.network import Detects, NetworkConfig, load_detector
from asdfviz.methods.part_poses import poses_from_keypoints
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.timing import StageTimer
from asdfviz.pose.pnp import PnpConfig
from asdfviz.state.joints import deviation
from asdfviz.track.tracker import Tracker


@dataclass(frozen=True)
class GbotReinitConfig(GbotConfig):
    """Options of GBOT with re-initialisation."""

    detector: NetworkConfig = field(default_factory=lambda: NetworkConfig(confidence=0.35))
    """The network; score as in GBOT's evaluator."""
    pnp: PnpConfig = field(default_factory=PnpConfig)
    """From keypoints to a pose."""
    every: int = 10
    """Frames from one re-initialisation to the next."""
    keep_near: float = 0.05
    """A tracked pose this near to the detector's (metres) is kept."""
    keep_angle_deg: float = 20.0
    """And turned by less than this, degrees; symmetric poses count as the same."""
    faithful: bool = False
    """Take every detected pose, as the published code does by a slip."""


class GbotReinit(Gbot):
    """GBOT, with a detector that finds lost and new parts."""

    def __init__(self, config: GbotReinitConfig, *, detector: Detects | None = None) -> None:
        """Keep the config.

        Args:
            config: the options.
            detector: used instead of the configured network.
        """
        super().__init__(config)
        self._options = config
        self._given_detector = detector
        self._found: tuple[Assembly, Detects] | None = None
        self._frames = 0
        self._boxes: dict[str, Box] = {}

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the network and the parts' viewpoint models.

        Raises:
            MethodError: there is no start.
            WeightsError: there are no weights for this assembly.
        """
        super().reset(assembly, camera, initial)
        detector = self._given_detector or load_detector(self._options.detector, assembly)
        self._found = assembly, detector
        self._frames = 0
        self._boxes = {}

    def before_tracking(self, tracker: Tracker, frame: Frame, timed: StageTimer) -> None:
        """Every so many frames, detect and replace what is too far off."""
        self._frames += 1
        if self._frames % self._options.every:
            return
        if self._found is None:
            raise MethodError("gbot_reinit: reset() must come before step()")
        assembly, detector = self._found
        with timed("detect"):
            detections = detector.detect(frame.rgb)
        with timed("pnp"):
            found = assign_detections(detections, assembly, previous=self._boxes)
            self._boxes |= {name: detection.box_xyxy for name, detection in found.items()}
            poses = poses_from_keypoints(found, frame, assembly, config=self._options.pnp)
        with timed("track"):
            seen = {name: pose.T_camera_part for name, pose in poses.items()}
            tracker.replace(frame, self._too_far(seen, tracker, assembly))
            new = {name: T for name, T in seen.items() if name not in tracker.names}
            if new:
                tracker.add(frame, new)
                self.rejoin(tracker, assembly)

    def _too_far(
        self, seen: Mapping[str, Transform], tracker: Tracker, assembly: Assembly
    ) -> dict[str, Transform]:
        """The detector's poses of tracked parts whose own pose is not to be kept."""
        tracked = tracker.poses
        return {
            name: T
            for name, T in seen.items()
            if name in tracked
            and (self._options.faithful or not self._near(tracked[name], T, assembly.parts[name]))
        }

    def _near(self, T_tracked: Transform, T_seen: Transform, part: Part) -> bool:
        centre = (part.mesh.vertices.min(axis=0) + part.mesh.vertices.max(axis=0)) / 2
        off = deviation(T_seen, T_tracked, center_part=centre, symmetries=part.symmetries)
        return off.within(self._options.keep_near, self._options.keep_angle_deg)


SPEC = MethodSpec(
    name="gbot_reinit",
    summary="GBOT, corrected by the detector every tenth frame",
    config=GbotReinitConfig,
    factory="asdfviz.methods.gbot_reinit:GbotReinit",
    initial="first_frame_truth",
    viewpoints=True,
)
