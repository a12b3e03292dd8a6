"""A part that was put somewhere by hand, settled there in the turn that the picture has it in.

`asdfviz.track.fitting` settles a pose that is about right. Where a part was put by a click, its turn may
be any: so rotations from all sides are compared there by outline and depth, the best few settled by
contours and depth too, and one of them taken only where it is clearly better than the pose nearby. Not
in the paper; for the annotator.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Frame, Part
from asdfviz.errors import Stopped
from asdfviz.geometry.rotation_grid import (
    Equivalents,
    Quaternions,
    angles_of,
    even_rotations,
    rotation_to_ray,
    rotations_of,
)
from asdfviz.geometry.sampling import hull_corners, oriented_surface_points
from asdfviz.geometry.shapes import Depth, Transform
from asdfviz.geometry.symmetry import symmetric_angle
from asdfviz.geometry.transforms import apply_to_point, inverse, point_distance, transform_from
from asdfviz.pose.hypotheses import HypothesisConfig, Poses, refined
from asdfviz.pose.hypothesis_kernels import agreement, slid
from asdfviz.pose.outline_at import outline_at
from asdfviz.pose.part_view import PartView, Surface, sampled_depth
from asdfviz.track.bodies import Body
from asdfviz.track.fitting import fitted
from asdfviz.track.presets import FINE, RBOT_REGION
from asdfviz.track.starts import Trial
from asdfviz.track.tracker import Tracker

Doubt: TypeAlias = Literal["alike", "poor", "untried"]
"""Another pose fits as well; little fits; other turns cannot be told apart without depth."""

SIDE, POINTS = 72, 1500
"""Cells a side of the view in which turns are compared, and points of the surface."""
AROUND = 1.5
"""The view reaches so many radii of the part from its middle."""
_NAME = "part"


@dataclass(frozen=True)
class TurnedConfig:
    """How turns are found and chosen."""

    rotations: int = 900
    """Compared by outline and depth: about 23 degrees apart."""
    apart_deg: float = 25.0
    """Those that are settled are turned from each other by this or more."""
    settled: int = 14
    """So many of the best are settled by contours and depth."""
    rounds: int = 2
    """The colours are learnt anew where a round ended."""
    contrast: float = 0.25
    """Weight of the colours at the contour against close depth and outline; fitted on 68 clicks on the
    parts of the sample and the vise, and 35 in 16 training images."""
    farthest: tuple[float, float] = (1.25, 0.005)
    """A part stays within so many of its radii, and metres more, of where it was put."""
    clearly: float = 0.15
    """What is found in another turn has to score more than the pose nearby by this."""
    alike: float = 0.06
    """Poses that score less by no more than this fit as well,"""
    other: tuple[float, float] = (0.35, 0.01)
    """if they are turned by as much (radians) or as far off (metres)."""
    poor: float = 0.4
    """Where less of the seen surface is close to the measured depth, little fits, 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class HandFit:
    """Where a part was settled, and what speaks against it."""

    T_camera_part: Transform
    doubt: Doubt | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Scored:
    T_camera_part: Transform
    trial: Trial
    score: float


def fitted_in_any_turn(
    frame: Frame,
    T_camera_part: Transform,
    *,
    part: Part,
    body: Body,
    stop: Callable[[], bool] = lambda: False,
    config: TurnedConfig | None = None,
) -> HandFit | None:
    """Settle a part near where it was put, turned as it was or otherwise; None where it fits nowhere.

    Args:
        frame: that shows the part; without depth, contours settle it in about the turn that it has.
        T_camera_part: about where it is; its turn may be any.
        part: what was put there.
        body: of the part.
        stop: asked now and then whether to go on.
        config: how turns are found and chosen.

    Raises:
        InputError: the frame's picture is not of its camera's size.
        Stopped: `stop` said so.
    """
    config = config or TurnedConfig()
    settings = RBOT_REGION if frame.depth is None else FINE
    near = fitted(frame, T_camera_part, body=body, camera=frame.camera, config=settings)
    if frame.depth is None:
        return None if near is None else HandFit(near.T_camera_part, "untried")
    place = _Place(frame, frame.depth, T_camera_part, part=part, config=config)
    tracker = Tracker({_NAME: body}, frame.camera, FINE)
    found: list[_Scored] = []
    for start in place.starts():
        if stop():
            raise Stopped("cancelled")
        trial = _settled(tracker, frame, start, rounds=config.rounds)
        if place.holds(trial.T_camera_part) and trial.confidence >= FINE.confidence.lost_below:
            found.append(place.scored(trial.T_camera_part, trial))
    if near is not None:
        trial = _settled(tracker, frame, near.T_camera_part, rounds=1)
        found.insert(0, place.scored(near.T_camera_part, trial))
    return _chosen(found, part=part, config=config, is_near=near is not None)


def _settled(tracker: Tracker, frame: Frame, start: Transform, *, rounds: int) -> Trial:
    """By contours and depth; each turn learns its own colours, as those of another speak for that one."""
    for left in reversed(range(rounds)):
        tracker.start(frame, {_NAME: start})
        (trial,) = tracker.trials(frame, _NAME, [start])
        if not left:
            return trial
        start = trial.T_camera_part
    raise ValueError(f"{rounds} rounds: use 1 or more")


def _chosen(
    found: Sequence[_Scored], *, part: Part, config: TurnedConfig, is_near: bool
) -> HandFit | None:
    """The best, or the first, where that is the pose nearby and none is clearly better."""
    if not found:
        return None
    best = max(found, key=lambda one: one.score)
    if is_near and best.score <= found[0].score + config.clearly:
        best = found[0]
    by, off = config.other

    def rivals(one: _Scored) -> bool:
        T, T_best = one.T_camera_part, best.T_camera_part
        is_other = symmetric_angle(T, T_best, part.symmetries) > by
        is_other |= point_distance(T, T_best, part.middle) > off
        return is_other and one.score >= best.score - config.alike

    if best.trial.sharp < config.poor:
        return HandFit(best.T_camera_part, "poor")
    return HandFit(best.T_camera_part, "alike" if any(map(rivals, found)) else None)


class _Place:
    """Where a part was put: what is seen there along the ray through its middle, and its turns."""

    def __init__(
        self, frame: Frame, depth: Depth, T_put: Transform, *, part: Part, config: TurnedConfig
    ) -> None:
        self._part, self._config, self._T_put = part, config, T_put
        vertices, middle = part.mesh.vertices, part.middle
        points, normals = oriented_surface_points(vertices, part.mesh.faces, POINTS)
        self._surface = Surface(points, normals, hull_corners(vertices), middle)
        self._radius = float(np.linalg.norm(vertices - middle, axis=1).max())
        at = apply_to_point(T_put, middle)
        self._distance = float(np.linalg.norm(at))
        focal = SIDE / 2 / (AROUND * self._radius / self._distance)
        R, K = rotation_to_ray(at), np.asarray(frame.camera.K, np.float64)
        measured = sampled_depth(depth, K, R, focal=focal, side=SIDE)
        thickness = float(np.ptp(vertices, axis=0).min())
        rim, core = self._radius * focal / self._distance, thickness * focal / self._distance
        outline = outline_at(
            frame,
            measured,
            R,
            focal=focal,
            rim=1.05 * rim + 1,
            core=max(0.3 * core, 1.5),
            between=(self._distance - 2 * self._radius, self._distance + 2 * self._radius),
        )
        box = np.array([0.0, 0.0, SIDE - 1.0, SIDE - 1.0])
        self._view = PartView(focal, R, outline, measured, box)
        self._T_camera_view = transform_from(R, np.zeros(3))
        self._how = HypothesisConfig()

    def holds(self, T_camera_part: Transform) -> bool:
        """Whether the part is still about where it was put."""
        radii, more = self._config.farthest
        moved = point_distance(T_camera_part, self._T_put, self._part.middle)
        return moved <= radii * self._radius + more

    def starts(self) -> list[Transform]:
        """T_camera_part in the turns that agree best with outline and depth, refined by these."""
        alike = Equivalents.of(self._part.symmetries)
        grid = even_rotations(self._config.rotations)
        if self._part.symmetries.is_symmetric:
            grid = _unlike(grid, alike)
        Ts = self._put(rotations_of(grid))
        order = np.argsort(-self._agreement(Ts).sum(axis=1), kind="stable")
        apart = np.deg2rad(self._config.apart_deg)
        kept: list[int] = []
        for i in map(int, order):
            if not kept or angles_of(alike.closeness(grid[i], grid[kept])).min() > apart:
                kept.append(i)
            if len(kept) == self._config.settled:
                break
        fitted = refined(Ts[kept], self._surface, self._view, self._how)
        return [self._T_camera_view @ T for T in fitted]

    def scored(self, T_camera_part: Transform, trial: Trial) -> _Scored:
        """With the number by which poses are compared: close depth, outline, and a little contrast."""
        T_view_part = inverse(self._T_camera_view) @ T_camera_part
        overlap = float(self._agreement(np.ascontiguousarray(T_view_part)[None])[0, 0])
        colors = self._config.contrast * trial.evidence.contrast
        return _Scored(T_camera_part, trial, trial.sharp + overlap + colors)

    def _put(self, Rs_camera_part: Float64[np.ndarray, "c 3 3"]) -> Poses:
        """T_view_part in each turn, moved along the ray to where depth is measured."""
        Rs_view_part = self._view.R_camera_view.T @ Rs_camera_part
        Ts = np.tile(np.eye(4), (len(Rs_view_part), 1, 1))
        Ts[:, :3, :3] = Rs_view_part
        Ts[:, :3, 3] = np.array([0, 0, self._distance]) - Rs_view_part @ self._surface.middle
        view, surface = self._view, self._surface
        seen = (view.focal, view.outline, view.measured)
        return slid(surface.points, Ts, *seen, self._how.max_shift, surface.middle)

    def _agreement(self, Ts_view_part: Poses) -> Float64[np.ndarray, "c 2"]:
        """Of outlines, and of depth, 0 to 1."""
        view = self._view
        seen = (view.focal, view.outline, view.measured)
        return agreement(self._surface.points, Ts_view_part, *seen, self._how.margin)[:, :2]


def _unlike(grid: Quaternions, alike: Equivalents) -> Quaternions:
    """Without those that a symmetry brings near to one before, as they look the same."""
    kept: list[int] = []
    left = np.ones(len(grid), bool)
    for i in range(len(grid)):
        if left[i]:
            kept.append(i)
            left &= angles_of(alike.closeness(grid[i], grid)) >= np.deg2rad(18)
    return grid[kept]
