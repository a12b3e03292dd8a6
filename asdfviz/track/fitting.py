"""One pose moved to where the picture agrees with it best, in its own frame.

For the annotator: a part that was put somewhere by hand is settled by its contours and depth.
"""

from __future__ import annotations

import numpy as np

from asdfviz.datatypes import Camera, Frame
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply_to_point
from asdfviz.track.bodies import Body
from asdfviz.track.keyframes import CarriedPose
from asdfviz.track.presets import FINE, TrackerConfig
from asdfviz.track.tracker import Tracker

ALONG, ASIDE = (0.0, -0.25, 0.25, -0.6, 0.6), (-0.4, 0.4)
"""Starts along the line of sight, and across it, in radii of the part."""
ROUNDS = 3
"""The colours are learnt anew where a round ended: those of a rough pose are partly the background's."""
_NAME = "part"


def fitted(
    frame: Frame,
    T_camera_part: Transform,
    *,
    body: Body,
    camera: Camera,
    config: TrackerConfig = FINE,
) -> CarriedPose | None:
    """Return the pose near a rough one that contours and depth agree with; None where none does.

    Args:
        frame: that shows the part.
        T_camera_part: about where it is.
        body: of the part.
        camera: of the frame.
        config: what the pose is settled by; contours alone where it asks for no depth.

    Raises:
        InputError: the frame does not fit the camera, or lacks the depth that is asked for.
    """
    tracker, best = Tracker({_NAME: body}, camera, config), T_camera_part
    middle = apply_to_point(T_camera_part, body.model.centre)
    radius = float(np.linalg.norm(body.centred.vertices, axis=1).max())
    ray = middle / np.linalg.norm(middle)
    shifts = [share * ray for share in ALONG]
    shifts += [share * axis for share in ASIDE for axis in np.eye(3)[:2]]
    starts: list[Transform] = []
    for shift in shifts:
        start = T_camera_part.copy()
        start[:3, 3] += radius * shift
        starts.append(start)
    for _ in range(ROUNDS):
        tracker.start(frame, {_NAME: best})
        trials = tracker.trials(frame, _NAME, starts)
        best = max(trials, key=lambda trial: trial.score).T_camera_part
        starts = [best]
    tracker.start(frame, {_NAME: best})
    sure = tracker.confidence(frame)[_NAME]
    return CarriedPose(best, sure) if sure >= config.confidence.lost_below else None
