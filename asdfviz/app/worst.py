"""The frames where the base run is farthest from what is known to be right. Pure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asdfviz.app.truths import truth_of
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AnnotationError


@dataclass(frozen=True, slots=True)
class WorstFrame:
    """A part that lies wrong in a frame."""

    place: int
    index: int
    part: str
    error_mm: float
    """Distance between the two positions of the part's frame."""


def worst_frames(
    workspace: Workspace, base: str | None, *, count: int = 5
) -> tuple[WorstFrame, ...]:
    """The worst part of each frame, worst frames first; none where nothing is known to be right."""
    try:
        truth = truth_of(workspace)
    except AnnotationError:
        return ()
    found: list[WorstFrame] = []
    run = workspace.run(base)
    for place, prediction in enumerate(run.by_place if run else ()):
        index = workspace.indices[place]
        right = truth.get(index)
        if prediction is None or right is None:
            continue
        errors = {
            name: 1000 * float(np.linalg.norm(pose.T_camera_part[:3, 3] - known[:3, 3]))
            for name, pose in prediction.poses.items()
            if (known := right.T_camera_part.get(name)) is not None
        }
        if errors:
            part = max(errors, key=lambda name: errors[name])
            found.append(WorstFrame(place, index, part, errors[part]))
    return tuple(sorted(found, key=lambda frame: -frame.error_mm)[:count])
