"""How sure parts are that something hides: those that the state holds, and those that lay still.

Not in the paper. Nothing of a hidden part can be seen, but the base that holds it can, and what lay
still before is more often there than not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from asdfviz.datatypes import Frame, Mesh, PoseEstimate
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.registration import projected_box, window
from asdfviz.methods.track_memory import Track
from asdfviz.track.raster import draw, new_buffers

LEAST = 0.15
"""Share of a part's pixels that other parts must leave free, or they hide it."""


def sure_as_it_lay(
    poses: Mapping[str, PoseEstimate], tracks: Mapping[str, Track], rest: AtRest, *, least: float
) -> dict[str, PoseEstimate]:
    """Return the poses, those of parts that are hidden where they lay still at least so sure.

    Args:
        poses: that are told of the frame.
        tracks: what is remembered of the parts.
        rest: what lies still.
        least: 0 to 1; 0 changes nothing.
    """
    told = dict(poses)
    for name, pose in poses.items():
        track = tracks[name]
        is_hidden = track.unsure > 0 and track.missing == 0 and not track.joined
        if is_hidden and pose.score < least and rest.lay(name, pose.T_camera_part):
            told[name] = replace(pose, score=least)
    return told


def sure_as_the_base(
    poses: Mapping[str, PoseEstimate],
    tracks: Mapping[str, Track],
    frame: Frame,
    *,
    meshes: Mapping[str, Mesh],
    base: str,
    share: float,
) -> dict[str, PoseEstimate]:
    """Return the poses, those of held parts that are hidden at least as sure as the base, times `share`.

    Where the part is seen, and does not fit, what is seen counts.

    Args:
        poses: that are told of the frame.
        tracks: what is remembered of the parts.
        frame: by whose camera other parts hide a part.
        meshes: of the parts.
        base: the part that holds the others.
        share: 0 to 1; 0 changes nothing.
    """
    if base not in poses:
        return dict(poses)
    told, least = dict(poses), share * poses[base].score
    for name, pose in poses.items():
        track = tracks[name]
        if pose.score >= least or not track.joined or not track.unsure:
            continue
        # What depth is well before is not missing; a lid lies too close before a part for that.
        if track.missing == 0 or _is_covered(name, poses, frame, meshes):
            told[name] = replace(pose, score=least)
    return told


def _is_covered(
    name: str, poses: Mapping[str, PoseEstimate], frame: Frame, meshes: Mapping[str, Mesh]
) -> bool:
    """Whether the other parts, where they are told to be, leave less than LEAST of a part free."""
    T_camera_part = poses[name].T_camera_part
    box = projected_box(T_camera_part, meshes[name].vertices, frame)
    (x0, y0, x1, y1), K = window(box, frame)
    if min(x1 - x0, y1 - y0) < 1:
        return False
    inverse_depth, ids = new_buffers(x1 - x0, y1 - y0)
    draw(meshes[name], T_camera_part, K=K, inverse_depth=inverse_depth, ids=ids, number=0)
    whole = int((ids == 0).sum())
    for other in poses.keys() - {name}:
        T_other = poses[other].T_camera_part
        draw(meshes[other], T_other, K=K, inverse_depth=inverse_depth, ids=ids, number=1)
    return int((ids == 0).sum()) < LEAST * whole
