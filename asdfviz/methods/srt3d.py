"""SRT3D: every part alone by its contour's colours (Stoiber et al., IJCV 2022). No depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.tracking import PartTrackerConfig
from asdfviz.track.presets import RBOT_REGION, TrackerConfig


@dataclass(frozen=True)
class Srt3dConfig(PartTrackerConfig):
    """Options of SRT3D."""

    tracker: TrackerConfig = RBOT_REGION
    """SRT3D's own settings for the RBOT data set."""
    PUBLISHED: ClassVar[TrackerConfig] = RBOT_REGION


SPEC = MethodSpec(
    name="srt3d",
    summary="Tracks every part from the first frame's truth by colour (SRT3D)",
    config=Srt3dConfig,
    factory="asdfviz.methods.tracking:PartTracker",
    initial="first_frame_truth",
    predicts=frozenset({"pose"}),
    viewpoints=True,
)
