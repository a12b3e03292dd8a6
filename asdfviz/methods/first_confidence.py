"""How probably a first pose is right: `asdf`'s score, from what its box, its outline, depth and the frames
before say.

Not in the paper, which leaves open what a pose's score is. The score of the box times the crops' agreement
withheld right poses: a screw that stands on its head is seldom named, yet lies in its outline and depth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace

from asdfviz.datatypes import Detection, Frame, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.odds import probability
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.registration import RegistrationConfig, evidence

READ = RegistrationConfig()
"""How depth is read; nothing is registered."""


@dataclass(frozen=True)
class FirstConfidenceConfig:
    """Weights of the logistic model.

    Fitted on 7,400 poses of nine synthetic sequences (the paper's assemblies, seeds 83 to 85, each sequence
    weighing the same, on either twin counts as right, which is ADD(S) below a tenth of the diameter).
    """

    enabled: bool = True
    """Whether scores are these probabilities; else they are the box's times the crops' agreement."""
    bias: float = -5.9
    """Log odds of a pose that nothing speaks for."""
    agreeing: float = 1.2
    """Per share of the visible depth readings on the surface, 0 to 1;"""
    unread: float = 1.0
    """and where there is no depth."""
    outline: float = 3.4
    """Per overlap of the projected box with the detected one, 0 to 1."""
    detection: float = 4.8
    """Per score of the detected box, 0 to 1."""
    steady: float = 2.0
    """Per overlap of the projected box with the detected one, if the part has been there for long: of 200
    such poses of eight sequences (seeds 83 to 86) that the others alone would have scored below 0.3, 192
    were right, 178 of them those of one screw that stands on its head."""
    long: int = 8
    """That is for so many frames; after fewer it counts for as much less."""
    placed_bias: float = -2.8
    """Log odds of a pose that a state places, scored 0 by the group,"""
    placed: float = 13.9
    """and per score, 0 to 1. Fitted on 900 such poses of seven of those sequences: of those that score 0.4
    or more 1 of 558 was wrong, of those below 104 of 342."""

    def __post_init__(self) -> None:
        """Raise a MethodError where a weight is no number."""
        if self.long < 1:
            raise MethodError(f"first_confidence.long is {self.long}, use 1 or more")
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise MethodError(f"first_confidence.{field.name} is {value}, use a finite number")


def with_confidence(
    poses: Mapping[str, PoseEstimate],
    found: Mapping[str, Detection],
    shapes: Mapping[str, PartShape],
    frame: Frame,
    *,
    steady: Mapping[str, int],
    config: FirstConfidenceConfig,
) -> dict[str, PoseEstimate]:
    """The poses, scored by how probably they are right; one of its own without a box keeps its score.

    Args:
        poses: by part.
        found: the boxes that the parts were detected in.
        shapes: of the parts.
        frame: with or without depth.
        steady: for how many frames parts have been where they are.
        config: weights.
    """
    told = dict(poses)
    for name, pose in poses.items() if config.enabled else ():
        box = found.get(name)
        if pose.stage == "group":
            odds = config.placed_bias + config.placed * pose.score
        elif box is None:
            continue
        else:
            T, at = pose.T_camera_part, box.box_xyxy
            seen = evidence(T, shapes[name], frame, box_xyxy=at, config=READ)
            odds = config.bias + config.outline * seen.outline + config.detection * box.score
            odds += config.unread if frame.depth is None else config.agreeing * seen.agreeing
            odds += config.steady * seen.outline * min(steady[name] / config.long, 1.0)
        told[name] = replace(pose, score=probability(odds))
    return told
