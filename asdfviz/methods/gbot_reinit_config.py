"""Options of GBOT with re-initialisation."""

from __future__ import annotations

from dataclasses import dataclass, field

from asdfviz.methods.first_pose import CropPoseConfig, FirstPose
from asdfviz.methods.gbot import GbotConfig
from asdfviz.methods.network import NetworkConfig
from asdfviz.methods.thing_names import NamesConfig
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.pose.pnp import PnpConfig


@dataclass(frozen=True)
class GbotReinitConfig(GbotConfig):
    """Options of GBOT with re-initialisation."""

    detector: NetworkConfig = field(default_factory=lambda: NetworkConfig(confidence=0.35))
    """The network; score as in GBOT's evaluator."""
    pnp: PnpConfig = field(default_factory=PnpConfig)
    """From keypoints to a pose."""
    first_pose: FirstPose | None = None
    """What the detector's poses come from: keypoints (the paper) or hypotheses (crops around the
    boxes). Default: hypotheses if crop weights lie beside the assembly (crops.safetensors) or are
    named and it does not run as published, else keypoints."""
    crops: CropPoseConfig = field(default_factory=CropPoseConfig)
    """Poses from crops."""
    names: NamesConfig = field(default_factory=NamesConfig)
    """What the crop network makes of boxes; as published, nothing."""
    every: int = 10
    """Frames from one re-initialisation to the next."""
    every_lost: int = 3
    """The same while a part is lost; as published, `every`."""
    margin: float = 0.15
    """A pose of the detector's, settled and turned as need be, must fit the picture better than the
    tracked one by this (`Trial.score`); as published, it need not."""
    looks: float = 0.05
    """Where it is turned otherwise in about the same place, only if it looks more like that by so much."""
    keep_near: float = 0.05
    """A tracked pose this near to the detector's (metres) is kept."""
    keep_angle_deg: float = 20.0
    """And turned by less than this, degrees; symmetric poses count as the same."""
    turns: TurnConfig = field(default_factory=lambda: TurnConfig(a_frame=2, slack=0.03))
    """Whether parts that do not hang on the base are not rather turned otherwise: more must speak for it
    where all were begun at the truth. As published, nobody asks."""
    faithful: bool = False
    """Take every detected pose, as the published code does by a slip."""

    def __post_init__(self) -> None:
        """As published, poses come from keypoints unless asked otherwise."""
        if self.first_pose is None and not self.verified:
            object.__setattr__(self, "first_pose", "keypoints")

    @property
    def verified(self) -> bool:
        """Whether the picture decides between the detector's pose and the tracked one."""
        return not (self.published or self.faithful)
