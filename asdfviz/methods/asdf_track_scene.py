"""What `asdf_track` keeps through a sequence: tracks, what tells parts apart, and the followed state."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.datatypes import Assembly, Camera, StateEstimate
from asdfviz.geometry.shapes import Transform
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.followed_state import FollowedState
from asdfviz.methods.known_turns import KnownTurns
from asdfviz.methods.own_colors import OwnColors
from asdfviz.methods.part_tracks import PartTracks
from asdfviz.methods.shared_space import SharedSpace
from asdfviz.methods.still_there import StillThere
from asdfviz.methods.told_poses import ToldPoses
from asdfviz.methods.tracked_base import TrackedBase
from asdfviz.methods.unlike_twins import UnlikeTwins
from asdfviz.state.joint_places import JointPlaces
from asdfviz.state.part_names import PartNames
from asdfviz.state.place_odds import JoinedOdds


@dataclass(slots=True, eq=False)
class TrackScene:
    """What a sequence was started with, and the state that was said last."""

    assembly: Assembly
    parts: PartTracks
    followed: FollowedState
    odds: JoinedOdds
    twins: PartNames
    places: JointPlaces
    still: StillThere
    unlike: UnlikeTwins
    space: SharedSpace
    own: OwnColors
    told: ToldPoses
    base: TrackedBase
    known: KnownTurns
    state: StateEstimate | None = None

    @property
    def T_camera_base(self) -> Transform | None:
        """Where the base last surely was, None where it was not tracked."""
        return self.parts.last.get(self.assembly.base)


def track_scene(
    assembly: Assembly, camera: Camera, asdf: Asdf, *, config: AsdfTrackConfig
) -> TrackScene:
    """Begin a sequence.

    Args:
        assembly: of it.
        camera: of its first frame.
        asdf: that finds the first poses, begun with the same sequence.
        config: options.
    """
    shapes, looker = asdf.shapes, asdf.looker
    told = ToldPoses(assembly, shapes, config)
    followed = FollowedState(assembly, shapes, looker, config, smear=told.smear)
    own = OwnColors(assembly, config=config.own_colors)
    base = TrackedBase(assembly.base, asdf.votes)
    parts = PartTracks(
        assembly,
        camera,
        tracker=config.tracker,
        refind=config.refind,
        turns=config.turns,
        own=own,
        smear=told.smear,
        base=base,
    )
    return TrackScene(
        assembly=assembly,
        parts=parts,
        followed=followed,
        odds=JoinedOdds(followed.assembly),
        twins=PartNames(assembly, config=config.relative_pose),
        places=JointPlaces(assembly),
        still=StillThere(assembly, config=config.still_there),
        unlike=UnlikeTwins(assembly, config=config.unlike_twins),
        space=SharedSpace(assembly, config=config.shared_space),
        own=own,
        told=told,
        base=base,
        known=KnownTurns(assembly, parts.checks if config.base_votes.known_turns else None),
    )
