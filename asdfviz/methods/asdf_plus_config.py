"""Options of `asdf_plus`."""

from __future__ import annotations

from dataclasses import dataclass, field

from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.contour_fits import ContourConfig
from asdfviz.methods.first_confidence import FirstConfidenceConfig
from asdfviz.methods.group_poses import GroupConfig
from asdfviz.methods.in_table import InTableConfig
from asdfviz.methods.joint_turns import JointTurnsConfig
from asdfviz.methods.kept_poses import HypothesesConfig
from asdfviz.methods.leaps import LeapsConfig
from asdfviz.methods.loose_config import LooseConfig
from asdfviz.methods.lying import LyingConfig
from asdfviz.methods.on_table import NO_TABLE, OnTableConfig
from asdfviz.methods.own_colors import OwnColorsConfig
from asdfviz.methods.registration import RegistrationConfig
from asdfviz.methods.second_look import SecondLookConfig
from asdfviz.methods.seen_smear import SmearConfig
from asdfviz.methods.shared_space import SharedSpaceConfig
from asdfviz.methods.still_there import StillThereConfig
from asdfviz.methods.tolerances import REGISTERED_PLACES, SURELY_LOOSE
from asdfviz.methods.unlike_twins import UnlikeTwinsConfig
from asdfviz.pose.confidence import ConfidenceConfig
from asdfviz.state.fusion import FusionConfig
from asdfviz.state.group_fit import GroupFitConfig
from asdfviz.state.last_turns import LastTurnsConfig
from asdfviz.state.lately_loose import LatelyLooseConfig
from asdfviz.state.relative_pose import RelativePoseConfig
from asdfviz.state.smoothing import FOLLOWED, SmoothingConfig


@dataclass(frozen=True)
class AsdfPlusConfig(AsdfConfig):
    """Options of ASDF, which gives first poses, and of what is added."""

    first_confidence: FirstConfidenceConfig = field(
        init=False, default_factory=FirstConfidenceConfig
    )
    """Of ASDF's own poses: no option, poses are judged anew here."""
    published: bool = field(init=False, default=False)
    """Of ASDF alone: no option, this method is not in the paper."""
    fusion: FusionConfig = field(init=False, default_factory=FusionConfig)
    """Of ASDF's own state, which is not asked here: no option, `smoothing` counts instead."""
    group: GroupConfig = field(init=False, default_factory=lambda: GroupConfig(enabled=False))
    """Of ASDF's own last step, which is not taken here: no option, `joined` counts instead."""
    own_looks: bool = True
    """Whether the base's own pose says where the group is looked at: what is told is hidden more often here."""
    looks_every: int = 2
    """In one of so many frames the network is asked how the group looks; its last answer stands for the
    frames between. In the others there is time to look how parts lie (`lying.every`)."""
    registration: RegistrationConfig = field(default_factory=RegistrationConfig)
    """Six degrees of freedom from depth."""
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    """Poses kept side by side over time."""
    contours: ContourConfig = field(default_factory=ContourConfig)
    """The last millimetres."""
    confidence: ConfidenceConfig = field(default_factory=ConfidenceConfig)
    """How sure a pose is."""
    joined: GroupConfig = field(default_factory=lambda: GroupConfig(enabled=True))
    """State helps pose, after the registration."""
    on_table: OnTableConfig = NO_TABLE
    """Off: contours settle poses here."""
    laid: OnTableConfig = field(default_factory=OnTableConfig)
    """How the table mends poses that are settled, as they are told; none goes on from there."""
    at_rest: AtRestConfig = field(default_factory=AtRestConfig)
    """What lies still is told as most frames have it;"""
    lying: LyingConfig = field(default_factory=LyingConfig)
    """what lies on it is told as it looks most like what is seen,"""
    joint_turns: JointTurnsConfig = field(default_factory=JointTurnsConfig)
    """and so is what turns in its joint."""
    smear: SmearConfig = field(default_factory=SmearConfig)
    """How it is seen how the depth camera smears, for all that is drawn."""
    doubts: float = 0.2
    """Of the network in the rotation of the frame before; runners-up are kept besides."""
    second_look: SecondLookConfig = field(default_factory=lambda: SecondLookConfig(enabled=True))
    """Where the detector looks again for parts that it missed."""
    relative_pose: RelativePoseConfig = REGISTERED_PLACES
    """S_P; narrower than ASDF's, as the poses are."""
    group_fit: GroupFitConfig = field(default_factory=GroupFitConfig)
    """The hypothesis test over states."""
    loose: LooseConfig = field(default_factory=lambda: LooseConfig(far_sure=0.5))
    """What lies loose, and what no longer does, as a witness for the state;"""
    lately_loose: LatelyLooseConfig = SURELY_LOOSE
    """and what lay loose a moment ago."""
    last_turns: LastTurnsConfig = field(default_factory=LastTurnsConfig)
    """What tells how a part is turned that its place hides."""
    smoothing: SmoothingConfig = FOLLOWED
    """The hidden Markov model, online."""
    still_there: StillThereConfig = field(default_factory=StillThereConfig)
    """What stood there while a part was surely elsewhere is not that part."""
    unlike_twins: UnlikeTwinsConfig = field(default_factory=UnlikeTwinsConfig)
    """Nor is what looks quite unlike its twins."""
    own_colors: OwnColorsConfig = field(default_factory=OwnColorsConfig)
    """What has quite another tint than the part surely had is not the part."""
    leaps: LeapsConfig = field(default_factory=LeapsConfig)
    """What is farther from where a part was than a hand could have brought it has to be surer."""
    in_table: InTableConfig = field(default_factory=InTableConfig)
    """What would stand in the table is not the part,"""
    shared_space: SharedSpaceConfig = field(default_factory=SharedSpaceConfig)
    """nor the less sure one of two loose parts that would stand in one another."""
    least_score: float = 0.5
    """Poses that are more probably wrong than right are withheld, unless a state places the part; 0
    gives all. They are kept, and speak for states. Without depth too little is known, and all are given."""
