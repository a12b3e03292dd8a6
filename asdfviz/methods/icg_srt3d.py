"""ICG+SRT3D: SRT3D's region modality with ICG's depth modality beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.tracking import PartTrackerConfig
from asdfviz.track.depth_modality import DepthConfig
from asdfviz.track.presets import RBOT_REGION, TrackerConfig

SETTINGS = replace(RBOT_REGION, depth=DepthConfig())
"""SRT3D's region settings for RBOT, ICG's depth settings for YCB-Video."""


@dataclass(frozen=True)
class IcgSrt3dConfig(PartTrackerConfig):
    """Options of the combination; the papers name it and give no settings."""

    tracker: TrackerConfig = SETTINGS
    """What evidence is used, and how."""
    PUBLISHED: ClassVar[TrackerConfig] = SETTINGS


SPEC = MethodSpec(
    name="icg_srt3d",
    summary="Tracks every part from the first frame's truth: SRT3D's colour, ICG's depth",
    config=IcgSrt3dConfig,
    factory="asdfviz.methods.tracking:PartTracker",
    initial="first_frame_truth",
    predicts=frozenset({"pose"}),
    viewpoints=True,
)
