"""ICG: every part alone by colour and depth (Stoiber et al., CVPR 2022)."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.tracking import PartTrackerConfig
from asdfviz.track.presets import GBOT, TrackerConfig


@dataclass(frozen=True)
class IcgConfig(PartTrackerConfig):
    """Options of ICG."""

    tracker: TrackerConfig = GBOT
    """What GBOT's evaluator runs as ICG: its own settings, without links between parts."""


SPEC = MethodSpec(
    name="icg",
    summary="Tracks every part from the first frame's truth by colour and depth (ICG)",
    config=IcgConfig,
    factory="asdfviz.methods.tracking:PartTracker",
    initial="first_frame_truth",
    predicts=frozenset({"pose"}),
    viewpoints=True,
)
