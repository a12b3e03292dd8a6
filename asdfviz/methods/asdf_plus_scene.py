"""What `asdf_plus` keeps through a sequence: hypotheses, contours, groups and what follows the state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from asdfviz.datatypes import Assembly, Camera
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.contour_fits import ContourFits
from asdfviz.methods.first_pose import LooksAtParts
from asdfviz.methods.followed_state import FollowedState
from asdfviz.methods.group_contours import GroupContours
from asdfviz.methods.group_poses import GroupPoses
from asdfviz.methods.known_turns import KnownTurns
from asdfviz.methods.looked_at import LastLooks
from asdfviz.methods.mistaken import Mistaken
from asdfviz.methods.one_place import OnePlace
from asdfviz.methods.part_hypotheses import PartHypotheses
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.shared_space import SharedSpace
from asdfviz.methods.told_poses import ToldPoses
from asdfviz.methods.tracking import load_bodies
from asdfviz.methods.unlike_twins import UnlikeTwins
from asdfviz.state.part_names import PartNames
from asdfviz.state.place_odds import JoinedOdds


@dataclass(frozen=True, slots=True, eq=False)
class PlusScene:
    """What stays the same through a sequence."""

    assembly: Assembly
    hypotheses: dict[str, PartHypotheses]
    followed: FollowedState
    group: GroupPoses
    odds: JoinedOdds
    twins: PartNames
    one_place: OnePlace
    told: ToldPoses
    looks: LastLooks
    mistaken: Mistaken
    known: KnownTurns
    unlike: UnlikeTwins
    space: SharedSpace
    contours: ContourFits | None
    together: GroupContours | None
    """None where contours are not asked."""

    @property
    def T_camera_base(self) -> Transform | None:
        """The base's most trusted pose by itself so far, None where there is none."""
        return self.hypotheses[self.assembly.base].best


def plus_scene(
    assembly: Assembly,
    camera: Camera,
    shapes: Mapping[str, PartShape],
    looker: LooksAtParts | None,
    *,
    config: AsdfPlusConfig,
) -> PlusScene:
    """Begin a sequence.

    Args:
        assembly: of it.
        camera: of its first frame.
        shapes: of the parts.
        looker: the crop network, None where there is none.
        config: options.
    """
    contours, kept, registration = config.contours, config.hypotheses, config.registration
    bodies = load_bodies(assembly) if contours.enabled else None
    told = ToldPoses(assembly, shapes, config)
    followed = FollowedState(assembly, shapes, looker, config, smear=told.smear)
    fits = together = None
    if bodies is not None:
        fits = ContourFits(assembly.parts, bodies, camera, config=contours, smear=told.smear)
        if contours.together:
            together = GroupContours(bodies, camera, base=assembly.base, config=contours)
    return PlusScene(
        assembly=assembly,
        hypotheses={
            n: PartHypotheses(p, shapes[n], config=kept, registration=registration, phase=i)
            for i, (n, p) in enumerate(assembly.parts.items())
        },
        followed=followed,
        group=GroupPoses(followed.assembly, shapes, config=config.joined),
        odds=JoinedOdds(followed.assembly),
        twins=PartNames(assembly, config=config.relative_pose),
        one_place=OnePlace(assembly),
        told=told,
        looks=LastLooks(),
        mistaken=Mistaken(
            assembly, config=config.still_there, own=config.own_colors, leaps=config.leaps
        ),
        known=KnownTurns(assembly, fits if config.base_votes.known_turns else None),
        unlike=UnlikeTwins(assembly, config=config.unlike_twins),
        space=SharedSpace(assembly, config=config.shared_space),
        contours=fits,
        together=together,
    )
