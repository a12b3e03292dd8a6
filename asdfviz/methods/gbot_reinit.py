"""GBOT with re-initialisation: every tenth frame a detector's poses correct the tracker's.

With crop weights, those come from crops around the boxes; the paper's own from keypoints. The
published code compares an angle with itself where it asks whether the tracker's pose is near enough
to be kept, so that it always takes the detector's. What it means is done here; `faithful` does what
it does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import attrgetter

from asdfviz.datatypes import (
    Assembly,
    Camera,
    Detection,
    Frame,
    FramePrediction,
    Part,
    PoseEstimate,
)
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import nearest_symmetric
from asdfviz.methods.first_pose import CropPoses, LooksAtParts, crop_poses
from asdfviz.methods.gbot import Gbot
from asdfviz.methods.gbot_reinit_config import GbotReinitConfig
from asdfviz.methods.network import Detects, load_detector
from asdfviz.methods.part_finder import PartFinder
from asdfviz.methods.part_poses import (
    PartShape,
    part_shapes,
    poses_fitted_to_boxes,
    poses_from_keypoints,
    poses_refined_by_depth,
)
from asdfviz.methods.refinding import QUARTER_TURNS, turned
from asdfviz.methods.second_look import SecondLookConfig
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.timing import StageTimer
from asdfviz.methods.tracking import Following
from asdfviz.methods.turn_checks import TurnChecks
from asdfviz.pose.box_fit import BoxFitConfig
from asdfviz.pose.icp import IcpConfig
from asdfviz.pose.translation import TranslationConfig
from asdfviz.state.joints import deviation
from asdfviz.state.twins import PlaceNames, renamed
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

ROUGH_ROUNDS = 3
"""Correspondence searches by which the turns of a detected pose are compared."""
KEPT = 3
"""So many of them are then settled in full."""


class GbotReinit(Gbot):
    """GBOT, with a detector that finds lost and new parts."""

    def __init__(
        self,
        config: GbotReinitConfig,
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
        super().__init__(config)
        self._options = config
        self._given_detector, self._given_looker = detector, looker
        self._crop_poses: CropPoses | None = None
        self._finder: PartFinder | None = None
        self._checks: TurnChecks | None = None
        self._assembly: Assembly | None = None
        self._twins: PlaceNames | None = None
        self._frames = 0
        self._shapes: dict[str, PartShape] = {}

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Load the network and the parts' viewpoint models.

        Raises:
            MethodError: there is no start.
            WeightsError: there are no weights for this assembly.
        """
        super().reset(assembly, camera, initial)
        options = self._options
        detector = self._given_detector or load_detector(options.detector, assembly)
        self._crop_poses = crop_poses(
            options.first_pose, options.crops, assembly, looker=self._given_looker
        )
        self._assembly = assembly
        self._twins = PlaceNames(assembly)
        self._shapes = part_shapes(assembly, surface_points=TranslationConfig().surface_points)
        looker = self._crop_poses.looker if self._crop_poses and options.verified else None
        self._finder = PartFinder(
            assembly,
            detector,
            self._shapes,
            looker=looker,
            names=options.names,
            second_look=SecondLookConfig(enabled=False),
            by_size=options.verified,
        )
        self._frames = 0
        if self._following is not None:
            bodies = self._following.bodies
            self._checks = TurnChecks(assembly.parts, bodies, config=options.turns)

    def before_tracking(self, following: Following, frame: Frame, timed: StageTimer) -> None:
        """Every so many frames, detect and replace what is too far off; in all, what is turned."""
        self._frames += 1
        options = self._options
        if options.verified:
            with timed("track"):
                self._turn(following, frame)
        searching = options.verified and following.lost
        if self._frames % (options.every_lost if searching else options.every):
            return
        if self._finder is None or self._assembly is None:
            raise MethodError("gbot_reinit: reset() must come before step()")
        assembly, tracker = self._assembly, following.tracker
        with timed("detect"):
            _, found = self._finder.find(frame)
            self._finder.keep(found, frame)
        with timed("pnp" if self._crop_poses is None else "crops"):
            starts = self._starts(found, frame, assembly)
            starts = _as_tracked(starts, tracker.poses.get(assembly.base), assembly)
        with timed("track"):
            if options.verified:
                starts = self._named_by_tracks(starts, tracker)
            seen = {name: Ts[0] for name, Ts in starts.items()}
            off = self._too_far(seen, tracker, assembly)
            if options.verified:
                doubted = {n: starts[n] for n in seen if n in off or n in following.lost}
                off = self._fitting(doubted, tracker, frame)
            tracker.replace(frame, off)
            new = {name: T for name, T in seen.items() if name not in tracker.names}
            if new:
                tracker.add(frame, new)
                self.rejoin(tracker, assembly)
            following.placed([*off, *new])

    def _turn(self, following: Following, frame: Frame) -> None:
        """Turn parts that hang on nothing to how they are."""
        if self._checks is None:
            raise MethodError("gbot_reinit: reset() must come before step()")
        poses, attached = following.tracker.poses, self.attached
        fixed = attached if len(attached) > 1 else ()  # nothing hangs on a base alone
        free = {name: T for name, T in poses.items() if name not in fixed}
        otherwise = self._checks.step(frame, following.tracker, free)
        following.tracker.replace(frame, otherwise)
        following.placed(list(otherwise))

    def _starts(
        self, found: Mapping[str, Detection], frame: Frame, assembly: Assembly
    ) -> dict[str, list[Transform]]:
        """Where the detector has each part, the likeliest pose first.

        Keypoints find places long before they tell rotations apart, so their poses are to be tried
        in all quarter turns; crops have their own runners-up.
        """
        if self._crop_poses is not None:
            looks = self._crop_poses.looked_at(found, frame, use_depth=True)
            return {n: [one.T_camera_part for one in look.settled] for n, look in looks.items()}
        poses = poses_from_keypoints(found, frame, assembly, config=self._options.pnp)
        if not self._options.verified:
            return {name: [pose.T_camera_part] for name, pose in poses.items()}
        return {
            name: [
                turned(pose.T_camera_part, R, centre=assembly.parts[name].middle)
                for R in QUARTER_TURNS
            ]
            for name, pose in self._put_right(poses, found, frame).items()
        }

    def _named_by_tracks(
        self, starts: Mapping[str, list[Transform]], tracker: Tracker
    ) -> dict[str, list[Transform]]:
        """Twins by the names of those that the tracker has nearest; the detector learns them."""
        if self._twins is None or self._finder is None:
            raise MethodError("gbot_reinit: reset() must come before step()")
        names = self._twins.follows({n: Ts[0] for n, Ts in starts.items()}, tracker.poses)
        self._finder.rename(names)
        return renamed(starts, names)

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

    def _put_right(
        self, poses: Mapping[str, PoseEstimate], found: Mapping[str, Detection], frame: Frame
    ) -> dict[str, PoseEstimate]:
        """Correct distances by the boxes and by depth; keypoints tell them worst."""
        poses = poses_fitted_to_boxes(poses, found, self._shapes, frame, config=BoxFitConfig())
        return poses_refined_by_depth(
            poses,
            found,
            self._shapes,
            frame,
            refinement="translation",
            translation=TranslationConfig(),
            icp=IcpConfig(),
        )

    def _fitting(
        self, starts: Mapping[str, Sequence[Transform]], tracker: Tracker, frame: Frame
    ) -> dict[str, Transform]:
        """Where the picture fits better than at the tracked poses."""
        found: dict[str, Transform] = {}
        for name, Ts in starts.items():
            rough = tracker.trials(frame, name, Ts, rounds=ROUGH_ROUNDS)
            rough = sorted(rough, key=attrgetter("score"), reverse=True)[:KEPT]
            now, *others = tracker.trials(
                frame, name, [tracker.poses[name], *(trial.T_camera_part for trial in rough)]
            )
            best = max(others, key=attrgetter("score"))
            is_sure = best.confidence >= tracker.config.confidence.lost_below
            is_better = best.score > now.score + self._options.margin
            if is_sure and is_better and self._looks_so(frame, name, now, best):
                found[name] = best.T_camera_part
        return found

    def _looks_so(self, frame: Frame, name: str, now: Trial, other: Trial) -> bool:
        """Whether a part looks like being turned so, or is elsewhere, of which looks say nothing."""
        T_now, T_other = now.T_camera_part, other.T_camera_part
        looks = (
            None if self._checks is None else self._checks.in_favour(frame, name, T_now, T_other)
        )
        return looks is None or looks > self._options.looks

    def _near(self, T_tracked: Transform, T_seen: Transform, part: Part) -> bool:
        off = deviation(T_seen, T_tracked, center_part=part.middle, symmetries=part.symmetries)
        return off.within(self._options.keep_near, self._options.keep_angle_deg)


def _as_tracked(
    starts: Mapping[str, list[Transform]], T_camera_base: Transform | None, assembly: Assembly
) -> dict[str, list[Transform]]:
    """The poses, those of a base that looks the same turned as it is tracked: on that the others hang."""
    base = assembly.base
    if T_camera_base is None or base not in starts:
        return dict(starts)
    symmetries = assembly.parts[base].symmetries
    return {**starts, base: [nearest_symmetric(T, T_camera_base, symmetries) for T in starts[base]]}


SPEC = MethodSpec(
    name="gbot_reinit",
    summary="GBOT, corrected by the detector every tenth frame",
    config=GbotReinitConfig,
    factory="asdfviz.methods.gbot_reinit:GbotReinit",
    initial="first_frame_truth",
    viewpoints=True,
)
