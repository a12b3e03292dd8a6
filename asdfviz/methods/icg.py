"""ICG: every part alone by colour and depth (Stoiber et al., CVPR 2022)."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.tracking import PartTrackerConfig


@dataclass(frozen=True)
class IcgConfig(PartTrackerConfig):
    """Options of ICG; as published, it has the settings of GBOT's evaluator without links."""


SPEC = MethodSpec(
    name="icg",
    summary="Tracks every part from the first frame's truth by colour and depth (ICG)",
    config=IcgConfig,
    factory="asdfviz.methods.tracking:PartTracker",
    initial="first_frame_truth",
    predicts=frozenset({"pose"}),
    viewpoints=True,
)
