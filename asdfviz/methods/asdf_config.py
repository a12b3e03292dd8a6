"""Options of the paper's pipeline, stage by stage."""

from __future__ import annotations

from dataclasses import dataclass, field

from asdfviz.errors import MethodError
from asdfviz.methods.base_votes_config import BaseVotesConfig
from asdfviz.methods.contests import ContestsConfig
from asdfviz.methods.first_confidence import FirstConfidenceConfig
from asdfviz.methods.first_pose import CropPoseConfig, FirstPose
from asdfviz.methods.group_poses import GroupConfig
from asdfviz.methods.network import NetworkConfig
from asdfviz.methods.on_table import OnTableConfig
from asdfviz.methods.part_poses import PAPER_ICP, Refinement
from asdfviz.methods.place_looks import PlaceLooksConfig
from asdfviz.methods.published import FUSED_STEPS, publish
from asdfviz.methods.rivals import RivalsConfig
from asdfviz.methods.second_look import SecondLookConfig
from asdfviz.methods.state_looks import StateLooksFrom
from asdfviz.methods.thing_names import NamesConfig
from asdfviz.methods.unlike_twins import UnlikeTwinsConfig
from asdfviz.pose.box_fit import BoxFitConfig
from asdfviz.pose.icp import IcpConfig
from asdfviz.pose.pnp import ROBUST_PNP, PnpConfig
from asdfviz.pose.translation import TranslationConfig
from asdfviz.state.appearance import AppearanceConfig
from asdfviz.state.fusion import FusionConfig
from asdfviz.state.lately_loose import LatelyLooseConfig
from asdfviz.state.relative_pose import RelativePoseConfig


@dataclass(frozen=True)
class AsdfConfig:
    """Options of the whole pipeline, stage by stage."""

    detector: NetworkConfig = field(default_factory=NetworkConfig)
    """The network."""
    pnp: PnpConfig = ROBUST_PNP
    """From keypoints to a pose."""
    first_pose: FirstPose | None = None
    """What first poses come from: keypoints (the paper) or hypotheses (crops around the boxes), the
    default if crop weights (crops.safetensors) lie beside the assembly or are named."""
    crops: CropPoseConfig = field(default_factory=CropPoseConfig)
    """First poses from crops."""
    doubts: float = 0.0
    """The rotation of the frame before is one hypothesis more, believed as much as the network's own
    best. This much of what the network thinks of it, frame by frame, goes into that, 0 to 1: doubt
    frees from wrong rotations, and loses right ones where a single frame says little."""
    box_fit: BoxFitConfig = field(default_factory=BoxFitConfig)
    """Distances that the boxes contradict."""
    refinement: Refinement = "translation"
    """What depth does to first poses: translation (the paper), icp, or none."""
    translation: TranslationConfig = field(default_factory=TranslationConfig)
    """Refinement "translation", section 3.1.1."""
    icp: IcpConfig = PAPER_ICP
    """Refinement "icp"."""
    on_table: OnTableConfig = field(default_factory=OnTableConfig)
    """What the table does to poses from crops."""
    names: NamesConfig = field(default_factory=NamesConfig)
    """What the crop network makes of boxes, where it was taught names."""
    second_look: SecondLookConfig = field(default_factory=SecondLookConfig)
    """Where the detector looks again for parts that it missed: off, the paper does not."""
    contests: ContestsConfig = field(default_factory=ContestsConfig)
    """Things that look about as much like a part as its best box, where first poses come from crops."""
    rivals: RivalsConfig = field(default_factory=RivalsConfig)
    """Further boxes of a part whose best one depth rules out."""
    unlike_twins: UnlikeTwinsConfig = field(
        default_factory=lambda: UnlikeTwinsConfig(tint=0.42, strange_tint=0.2)
    )
    """When what is taken for one of several like parts does not look like the others: more than where poses
    are near enough to see nothing else, as twins then differed by up to 0.33."""
    state_looks: StateLooksFrom | None = None
    """What tells the state by its looks: boxes (the paper: states as classes of the detector),
    crops (the crop network, looking about the base part) or places (the state network, looking where
    the base part's pose puts each joined part). Default, where first poses come from crops: places if
    there is such a network, else crops unless the detector is the assembly's own."""
    looks_every: int = 1
    """In one of so many frames the network is asked; its last answer stands for the frames between."""
    appearance: AppearanceConfig = field(default_factory=AppearanceConfig)
    """S_DL: from state boxes to probabilities."""
    place_looks: PlaceLooksConfig = field(default_factory=PlaceLooksConfig)
    """What the crop network sees where joined parts would stand."""
    relative_pose: RelativePoseConfig = field(default_factory=RelativePoseConfig)
    """S_P: from part poses to probabilities."""
    base_votes: BaseVotesConfig = field(default_factory=BaseVotesConfig)
    """When the base is not where its own pose says."""
    own_looks: bool = False
    """Whether the base's own pose says where the group is looked at, wherever the base is told to be."""
    lately_loose: LatelyLooseConfig = field(default_factory=LatelyLooseConfig)
    """For how long what lay loose is not joined yet."""
    fusion: FusionConfig = field(default_factory=FusionConfig)
    """Pose2State, equations 3 to 5."""
    group: GroupConfig = field(default_factory=GroupConfig)
    """State helps pose: parts that the state joins."""
    first_confidence: FirstConfidenceConfig = field(default_factory=FirstConfidenceConfig)
    """How sure a pose from crops is that no state places."""
    least_score: float = 0.2
    """Poses from crops that score less are withheld, 0 to 1, unless a state places the part; 0 gives
    all. They still speak for states."""
    published: bool = False
    """The paper's steps to the letter and none of ours; what it leaves open stays as configured."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range, or not as published."""
        if not 0 <= self.least_score <= 1:
            raise MethodError(f"least_score is {self.least_score:g}, use a score from 0 to 1")
        if self.looks_every < 1:
            raise MethodError(f"looks_every is {self.looks_every}, use 1 or more")
        if self.published:
            publish(self, FUSED_STEPS)
