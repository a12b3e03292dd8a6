"""What `asdf` keeps through a sequence: networks, shapes and what follows the frames."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from asdfviz.datatypes import Assembly, Detection, Frame
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.base_votes import BaseVotes
from asdfviz.methods.contests import Contests
from asdfviz.methods.first_pose import CropPoses, LooksAtParts, crop_poses
from asdfviz.methods.group_poses import GroupPoses
from asdfviz.methods.looked_at import Before, LookedAt
from asdfviz.methods.network import Detects, load_detector
from asdfviz.methods.part_finder import PartFinder
from asdfviz.methods.part_poses import PartShape, part_shapes
from asdfviz.methods.place_looks import PlaceLooks
from asdfviz.methods.pooled_keypoints import PooledKeypoints
from asdfviz.methods.state_looks import KeptLooks, StateLooks
from asdfviz.methods.steady_poses import SteadyPoses
from asdfviz.methods.unlike_twins import UnlikeTwins
from asdfviz.state.base_turns import BaseTurns
from asdfviz.state.fusion import Pose2State
from asdfviz.state.lately_loose import LatelyLoose
from asdfviz.state.part_names import PartNames

STEADY = 0.006
"""A part that moves by no more than this from one frame to the next is where it was, metres."""


@dataclass(frozen=True, slots=True, eq=False)
class AsdfScene:
    """What stays the same through a sequence."""

    assembly: Assembly
    finder: PartFinder
    shapes: dict[str, PartShape]
    pose2state: Pose2State
    crop_poses: CropPoses | None
    """None: first poses come from keypoints."""
    pooled: PooledKeypoints | None
    """None: they do not, or as published."""
    looks: KeptLooks
    place_looks: PlaceLooks
    group: GroupPoses
    twins: PartNames
    turns: BaseTurns
    votes: BaseVotes
    lately: LatelyLoose
    steady: SteadyPoses
    unlike: UnlikeTwins


def asdf_scene(
    assembly: Assembly,
    config: AsdfConfig,
    *,
    detector: Detects | None,
    looker: LooksAtParts | None,
    before: Callable[[], Mapping[str, Before]],
) -> AsdfScene:
    """Load the networks and sample the parts' surfaces.

    Args:
        assembly: of the sequence.
        config: options.
        detector: used instead of the configured network, if given.
        looker: used instead of the configured crop network, if given.
        before: where parts were in the frame before, asked in every frame.

    Raises:
        WeightsError: there are no weights for this assembly.
    """
    shapes = part_shapes(assembly, surface_points=config.translation.surface_points)
    sunk = config.on_table.counted
    first = crop_poses(config.first_pose, config.crops, assembly, looker=looker, sunk=sunk)
    detector = detector or load_detector(config.detector, assembly)
    looks = StateLooks.of(
        assembly,
        config=config.appearance,
        chosen=config.state_looks,
        detector=config.detector,
        crops=config.crops,
        crop_poses=first,
    )
    group = GroupPoses(assembly, shapes, config=config.group)
    pooled = None
    if first is None and not config.published:
        pooled = PooledKeypoints(assembly, shapes, config.pnp, config.translation)
    return AsdfScene(
        assembly=assembly,
        finder=_finder(assembly, config, detector, shapes, first, before),
        shapes=shapes,
        pose2state=Pose2State(assembly, config=config.fusion.chosen(places=looks.by_places)),
        crop_poses=first,
        pooled=pooled,
        looks=KeptLooks(looks, every=config.looks_every),
        place_looks=PlaceLooks(assembly, shapes, first and first.looker, config=config.place_looks),
        group=group,
        twins=PartNames(assembly, config=config.relative_pose),
        turns=BaseTurns(assembly, config=config.relative_pose),
        votes=BaseVotes(group, places=config.relative_pose, config=config.base_votes),
        lately=LatelyLoose(assembly, config=config.lately_loose),
        steady=SteadyPoses(assembly, apart=STEADY, by_twins=True),
        unlike=UnlikeTwins(assembly, config=config.unlike_twins),
    )


def _finder(
    assembly: Assembly,
    config: AsdfConfig,
    detector: Detects,
    shapes: Mapping[str, PartShape],
    first: CropPoses | None,
    before: Callable[[], Mapping[str, Before]],
) -> PartFinder:
    return PartFinder(
        assembly,
        detector,
        shapes,
        looker=None if first is None else first.looker,
        names=config.names,
        second_look=config.second_look.chosen(crops=first is not None),
        by_size=not config.published,
        by_class=config.published,
        contests=None if first is None else _contests(assembly, config, first, before),
    )


def _contests(
    assembly: Assembly,
    config: AsdfConfig,
    first: CropPoses,
    before: Callable[[], Mapping[str, Before]],
) -> Contests:
    def look(boxes: Mapping[str, Detection], frame: Frame) -> dict[str, LookedAt]:
        return first.looked_at(boxes, frame, use_depth=True, previous=before())

    return Contests(assembly, look, config.contests)
