"""What speaks against a pose that fits the picture: nobody else found it, and its tint is another.

Not in the paper. A tracker learns the colours of whatever it sits on, so that a hand or a strange thing
fits as well as the part. The detector's boxes, and the colours that the part had before, do not learn it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from asdfviz.datatypes import Frame, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.methods.own_colors import OwnColors
from asdfviz.methods.track_memory import Track
from asdfviz.methods.turn_config import TurnConfig


@dataclass(frozen=True)
class DoubtConfig:
    """How much less sure a pose is for what speaks against it.

    Chosen with four sequences behind rendered hands in view, 5,801 poses: 180 of the 305 loose ones that
    the detector hardly supported (below 0.3) were wrong, and 87 of 122 of another tint (above 0.5). What
    tells right from wrong there changes little with any of these figures.
    """

    unfound: float = 0.4
    """Share of the score that is left to a loose part that the detector does not support, 0 to 1;"""
    found: float = 1.0
    """with so much support all of it."""
    tint: tuple[float, float] = (0.35, 0.65)
    """Difference of tint (logarithm) up to which the score is left, and from which on but"""
    other: float = 0.1
    """this share of it, 0 to 1."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        low, high = self.tint
        if not (0 <= self.unfound <= 1 and 0 <= self.other <= 1 and self.found > 0):
            raise MethodError(
                f"doubt.unfound is {self.unfound:g}, other {self.other:g} and found {self.found:g}: "
                "unfound and other must be from 0 to 1, found above 0"
            )
        if not 0 <= low < high:
            raise MethodError(
                f"doubt.tint is {low:g} {high:g}: the first must be 0 or more, the second above it"
            )


def doubted(
    poses: Mapping[str, PoseEstimate],
    tracks: Mapping[str, Track],
    own: OwnColors,
    frame: Frame,
    *,
    config: DoubtConfig,
) -> dict[str, PoseEstimate]:
    """Return the poses, as sure as the detector and the colours of before leave them.

    Args:
        poses: that are told of the frame.
        tracks: what is remembered of the parts.
        own: the tints that they had.
        frame: in which they are seen.
        config: how much that counts.
    """
    told: dict[str, PoseEstimate] = {}
    for name, pose in poses.items():
        left = 1.0 if tracks[name].joined else _supported(tracks[name], config)
        if pose.score > 0:
            off = own.difference(frame, name, pose.T_camera_part)
            left *= 1.0 if off is None else _of_this_tint(off, config)
        told[name] = replace(pose, score=left * pose.score)
    return told


def contested(
    poses: Mapping[str, PoseEstimate], ahead: Mapping[str, float], *, config: TurnConfig
) -> dict[str, PoseEstimate]:
    """Return the poses, as sure as other turns of the parts leave them.

    Args:
        poses: that are told of a frame.
        ahead: by how much another turn of a part is ahead by what was seen.
        config: how much that counts.
    """
    told = dict(poses)
    for name, pose in poses.items():
        lead = ahead.get(name, 0.0)
        if lead > 0 and pose.stage != "group":
            share = min(1.0, lead / config.beaten_lead)
            left = config.contested + (config.beaten - config.contested) * share
            told[name] = replace(pose, score=left * pose.score)
    return told


def _supported(track: Track, config: DoubtConfig) -> float:
    share = min(1.0, track.support.own / config.found)
    return config.unfound + (1.0 - config.unfound) * share


def _of_this_tint(off: float, config: DoubtConfig) -> float:
    low, high = config.tint
    share = min(1.0, max(0.0, (high - off) / (high - low)))
    return config.other + (1.0 - config.other) * share
