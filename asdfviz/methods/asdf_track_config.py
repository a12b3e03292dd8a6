"""Options of `asdf_track`."""

from __future__ import annotations

from dataclasses import dataclass, field

from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.doubts import DoubtConfig
from asdfviz.methods.first_confidence import FirstConfidenceConfig
from asdfviz.methods.group_poses import GroupConfig
from asdfviz.methods.in_table import InTableConfig
from asdfviz.methods.joint_turns import JointTurnsConfig
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.methods.lying import LyingConfig
from asdfviz.methods.on_table import NO_TABLE, OnTableConfig
from asdfviz.methods.own_colors import OwnColorsConfig
from asdfviz.methods.refinding import RefindConfig
from asdfviz.methods.second_look import SecondLookConfig
from asdfviz.methods.seen_smear import SmearConfig
from asdfviz.methods.shared_space import SharedSpaceConfig
from asdfviz.methods.still_there import StillThereConfig
from asdfviz.methods.tolerances import TRACKED_PLACES
from asdfviz.methods.track_confidence import TrackConfidenceConfig
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.unlike_twins import UnlikeTwinsConfig
from asdfviz.state.fusion import FusionConfig
from asdfviz.state.group_fit import GroupFitConfig
from asdfviz.state.last_turns import LastTurnsConfig
from asdfviz.state.lately_loose import LatelyLooseConfig
from asdfviz.state.relative_pose import RelativePoseConfig
from asdfviz.state.smoothing import FOLLOWED, SmoothingConfig
from asdfviz.track.presets import PROPOSED, TrackerConfig


@dataclass(frozen=True)
class JoinConfig:
    """When parts are tracked as one."""

    probability: float = 0.6
    """Least probability of the state that joins them."""
    distance: float = 0.012
    """A part that can be seen joins only this near to its place, metres."""
    angle_deg: float = 20.0
    """And turned by less than this, degrees; symmetric poses count as the same."""
    patience: int = 3
    """A part that could not be seen for more frames than this joins wherever it was."""
    settled: float = 0.98
    """Probability of the state from which all of its parts join, wherever they were."""
    elsewhere: bool = True
    """Whether what is found elsewhere of parts that are held, and not seen there, is a loose twin, or
    speaks against the state if none is loose."""


@dataclass(frozen=True)
class AsdfTrackConfig(AsdfConfig):
    """Options of ASDF, which proposes poses, of the tracker, and of the state that is followed."""

    first_confidence: FirstConfidenceConfig = field(
        init=False, default_factory=FirstConfidenceConfig
    )
    """Of ASDF's own poses: no option, poses are judged anew here."""
    published: bool = field(init=False, default=False)
    """Of ASDF alone: no option, this method is not in the paper."""
    fusion: FusionConfig = field(init=False, default_factory=FusionConfig)
    """Of ASDF's own state, which is not asked here: no option, `smoothing` counts instead."""
    group: GroupConfig = field(init=False, default_factory=GroupConfig)
    """Of ASDF's own last step, which is not taken here: no option, `join` counts instead."""
    doubts: float = 0.2
    """Of the network in the rotation of the frame before; the tracker holds what is right."""
    on_table: OnTableConfig = NO_TABLE
    """Off: contours settle poses here."""
    laid: OnTableConfig = field(default_factory=OnTableConfig)
    """How the table mends poses, as they are told; the tracker goes on from its own."""
    at_rest: AtRestConfig = field(default_factory=AtRestConfig)
    """What lies still is looked for where it was, and told as most frames have it;"""
    lying: LyingConfig = field(default_factory=LyingConfig)
    """what lies on it is told as it looks most like what is seen,"""
    joint_turns: JointTurnsConfig = field(default_factory=JointTurnsConfig)
    """and so is what turns in its joint."""
    smear: SmearConfig = field(default_factory=SmearConfig)
    """How it is seen how the depth camera smears, for all that is drawn."""
    second_look: SecondLookConfig = field(default_factory=lambda: SecondLookConfig(enabled=True))
    """Where the detector looks again for parts that it missed."""
    relative_pose: RelativePoseConfig = TRACKED_PLACES
    """S_P: from part poses to probabilities; narrower than for detected poses."""
    group_fit: GroupFitConfig = field(default_factory=GroupFitConfig)
    """The hypothesis test over states."""
    loose: LooseConfig = field(default_factory=lambda: LooseConfig(carried=0.0, found=0.65))
    """What lies loose, and what no longer does, as a witness for the state: the tracker sees a part in the
    hand, so one that is gone is in its place soon, but goes on tracking what is hidden in its place
    beside it, with a score of about a half;"""
    lately_loose: LatelyLooseConfig = field(
        default_factory=lambda: LatelyLooseConfig(enabled=False)
    )
    """and what lay loose a moment ago: off, as the tracker follows what a hand carries."""
    last_turns: LastTurnsConfig = field(default_factory=LastTurnsConfig)
    """What tells how a part is turned that its place hides."""
    smoothing: SmoothingConfig = FOLLOWED
    """The hidden Markov model, online."""
    tracker: TrackerConfig = PROPOSED
    """What evidence the tracker uses, and how."""
    refind: RefindConfig = field(default_factory=RefindConfig)
    """From where parts are looked for."""
    turns: TurnConfig = field(default_factory=lambda: TurnConfig(lead_seen=0.2, near=0.1, was=0.1))
    """How it is told over time that a part is turned otherwise."""
    still_there: StillThereConfig = field(default_factory=StillThereConfig)
    """How a thing that lay there all along is told from a part that came to lie there."""
    unlike_twins: UnlikeTwinsConfig = field(default_factory=UnlikeTwinsConfig)
    """What looks quite unlike a part of the same kind is not the part."""
    own_colors: OwnColorsConfig = field(default_factory=OwnColorsConfig)
    """What has quite another tint than the part surely had is not the part."""
    in_table: InTableConfig = field(default_factory=InTableConfig)
    """What would stand in the table is not the part,"""
    shared_space: SharedSpaceConfig = field(default_factory=SharedSpaceConfig)
    """nor the less sure one of two loose parts that would stand in one another."""
    doubt: DoubtConfig = field(default_factory=DoubtConfig)
    """What makes poses less sure that fit the picture."""
    confidence: TrackConfidenceConfig = field(default_factory=TrackConfidenceConfig)
    """How probably a pose is right that fits so well."""
    join: JoinConfig = field(default_factory=JoinConfig)
    """When parts are tracked as one."""
    least_score: float = 0.0
    """Poses that score less are withheld: none, since what is lost is absent anyhow, and what is hidden
    is mostly where it was."""
