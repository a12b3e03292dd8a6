"""What lies still, though the camera moves: its pose is known better from all frames than from one.

Not in the paper. In a shaken, blurred picture a small part's rotation is off by something else in every
frame, but parts on a table lie still to each other. So where most of what is found has moved as one, the
camera has moved, and a part that moved with it is told where it lay, turned as most frames have it.
Where too few parts lie loose to tell, a camera that moved has come to rest once the base lies still.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from asdfviz.datatypes import Assembly, Frame, Part, PoseEstimate
from asdfviz.geometry.camera import nearest_pixels
from asdfviz.geometry.rigid_fit import agreement, rigid_fit, robust_fit
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.symmetry import nearest_symmetric, symmetric_angle
from asdfviz.geometry.transforms import (
    apply,
    apply_to_point,
    inverse,
    orthonormalized,
    point_distance,
    rotation_angle,
    transform_from,
)
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.state.twins import renamed

LEAST = 3
"""Parts that must have moved as one: of fewer nobody knows whether the camera moved, or they."""
MOST = 6
"""Ways in which a part may be turned that are remembered."""


@dataclass(slots=True, eq=False)
class _Way:
    """A pose in which a part was found again and again."""

    T_stage_part: Transform
    weight: float
    unseen: int = 0
    """Frames since it was."""


@dataclass(slots=True, eq=False)
class _Resting:
    """Where a part lies; the stage is what rests as a whole."""

    ways: list[_Way]
    frames: int = 0
    """That found it there."""
    away: int = 0
    """Frames in a row that found it elsewhere,"""
    absent: int = 0
    """or did not find it."""

    @property
    def told(self) -> _Way:
        """As most frames have it."""
        return max(self.ways, key=lambda way: way.weight)

    @property
    def T_stage_part(self) -> Transform:
        """As most frames have it."""
        return self.told.T_stage_part


class AtRest:
    """What lies still in one sequence."""

    def __init__(self, assembly: Assembly, *, config: AtRestConfig) -> None:
        """Begin a sequence: the stage is the first frame's camera."""
        self._parts, self._base, self._config = assembly.parts, assembly.base, config
        self._boxes = {name: _box(part) for name, part in assembly.parts.items()}
        self._resting: dict[str, _Resting] = {}
        self._there: frozenset[str] = frozenset()
        """Those that the last frame found where they lay."""
        self._T_camera_stage = np.eye(4)
        self._is_followed = False
        """Whether enough was seen to tell how the camera moved."""
        self._still = config.shaken
        """Frames since the camera moved."""

    @property
    def T_camera_stage(self) -> Transform:
        """Where all that rests was in the last frame; the identity until the camera has moved."""
        return self._T_camera_stage

    @property
    def is_shaken(self) -> bool:
        """Whether the camera moved lately."""
        return self._still < self._config.shaken

    def lies(self, name: str) -> bool:
        """Whether the last frame found a part where it lay."""
        return name in self._there

    def is_hidden(self, point_stage: Vector, frame: Frame, *, by: float) -> bool:
        """Whether something stands in front of a point by this, metres, or it is out of view; by depth."""
        assert frame.depth is not None
        point = apply_to_point(self._T_camera_stage, point_stage)
        inside, row, column = nearest_pixels(point[None], frame.camera.K, frame.depth.shape)
        if not inside[0]:
            return True
        return 0 < frame.depth[row[0], column[0]].item() < point[2].item() - by

    def lay(self, name: str, T_camera_part: Transform) -> bool:
        """Whether enough frames found a part there, and none since elsewhere; the last need not see it."""
        resting = self._resting.get(name)
        if resting is None or not self._is_there(resting):
            return False
        T_rests = self._T_camera_stage @ resting.T_stage_part
        apart = point_distance(T_camera_part, T_rests, self._parts[name].middle)
        return apart <= self._config.moved

    def see(self, poses: Mapping[str, PoseEstimate], *, joined: Collection[str]) -> None:
        """Take in the poses of a frame, and which parts only move with the base part."""
        if not self._config.enabled:
            return
        sure = {name: pose for name, pose in poses.items() if pose.score >= self._config.sure}
        loose = {name: pose for name, pose in sure.items() if name not in joined}
        self._resting = {n: resting for n, resting in self._resting.items() if n not in joined}
        T_camera_stage = self._followed(loose)
        self._is_followed = T_camera_stage is not None
        if T_camera_stage is not None:
            is_still = T_camera_stage is self._T_camera_stage
            self._T_camera_stage, self._still = T_camera_stage, self._still + 1 if is_still else 0
        for resting in self._resting.values():
            resting.absent += 1
        T_stage_camera = inverse(self._T_camera_stage)
        for name, pose in loose.items():
            self._see(name, T_stage_camera @ pose.T_camera_part, pose.score)
        if T_camera_stage is None and self._base in loose and self.is_shaken:  # the base tells
            self._still = 0 if self._resting[self._base].away else self._still + 1
        self._there = frozenset(n for n in loose if self._is_there(self._resting[n]))

    def expected(self, found: Mapping[str, PoseEstimate]) -> dict[str, Transform]:
        """Where parts at rest are in a new frame, T_camera_part, as first poses found have the camera moved."""
        config = self._config
        if not self.is_shaken:
            return {}
        sure = {name: pose for name, pose in found.items() if pose.score >= config.sure}
        T_camera_stage = self._followed(sure)
        if T_camera_stage is None:
            return {}
        return {
            name: T_camera_stage @ resting.T_stage_part
            for name, resting in self._resting.items()
            if self._is_known(resting) and resting.absent <= config.absent
        }

    def told(self, poses: Mapping[str, PoseEstimate]) -> dict[str, PoseEstimate]:
        """Poses of the frame that was seen last, those of loose parts at rest as most frames have them.

        Parts of stage `group` stay where they are, and with them the base part.
        """
        told = dict(poses)
        held = {name for name, pose in poses.items() if pose.stage == "group"}
        if not self.is_shaken or not self._is_followed:
            return told
        for name in self._there & poses.keys() - held - ({self._base} if held else set[str]()):
            resting, part = self._resting[name], self._parts[name]
            T_found = poses[name].T_camera_part
            T_rests = self._T_camera_stage @ resting.T_stage_part
            apart = point_distance(T_found, T_rests, part.middle)
            if not self._is_known(resting) or apart > self._config.turned:
                continue
            if self._is_otherwise(part, T_found, T_rests):
                told[name] = replace(poses[name], T_camera_part=T_rests)
        return told

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._resting = renamed(self._resting, names)

    def _followed(self, poses: Mapping[str, PoseEstimate]) -> Transform | None:
        """T_camera_stage by which most of what rested is where these poses have it; None: unknown."""
        before = self._T_camera_stage
        known = [name for name in poses if name in self._resting]
        if len(known) < LEAST:
            return None
        stage, camera = list[Points](), list[Points]()
        for name in known:
            T_stage_part = self._resting[name].T_stage_part
            T_found = poses[name].T_camera_part
            T_near = nearest_symmetric(T_found, before @ T_stage_part, self._parts[name].symmetries)
            stage.append(apply(T_stage_part, self._boxes[name]))
            camera.append(apply(T_near, self._boxes[name]))
        return self._fitted(stage, camera, [self._parts[name].diameter for name in known])

    def _fitted(self, stage: list[Points], camera: list[Points], weights: list[float]) -> Transform:
        """T_camera_stage from the corners of parts; each part counts by its weight."""
        before, scale = self._T_camera_stage, self._config.agree
        alike = np.ones(len(stage[0]))
        starts = [before, *(rigid_fit(a, b, alike) for a, b in zip(stage, camera, strict=True))]
        points = np.concatenate(stage), np.concatenate(camera), np.repeat(weights, len(alike))
        T_moved, agrees = robust_fit(*points, np.stack(starts), scale=scale)
        still = agreement(*points, before[None], scale=scale).item()
        if still >= self._config.unmoved * agrees:
            return before
        middles = np.mean(stage, axis=1), np.mean(camera, axis=1)
        off, was_off = (
            np.linalg.norm(apply(T, middles[0]) - middles[1], axis=1) for T in (T_moved, before)
        )
        moved = np.count_nonzero((off < self._config.moved) & (off < was_off))
        stayed = np.count_nonzero((was_off < self._config.moved) & (was_off < off))
        shift = np.linalg.norm(apply(T_moved, middles[0]) - apply(before, middles[0]), axis=1)
        is_motion = moved >= max(LEAST, stayed + 1) and np.median(shift) >= self._config.least
        return T_moved if is_motion else before

    def _see(self, name: str, T_stage_part: Transform, score: float) -> None:
        """One more frame's pose of a part."""
        config, part = self._config, self._parts[name]
        begun = _Resting([_Way(T_stage_part, score)], frames=1)
        resting = self._resting.setdefault(name, begun)
        if resting is begun:
            return
        resting.absent = 0
        way, T_near, turn = _nearest(resting, T_stage_part, part)
        is_same = turn < math.radians(config.same_deg)
        # What was only turned otherwise in its place still lies there.
        far = config.moved if is_same else config.turned
        is_away = point_distance(way.T_stage_part, T_stage_part, part.middle) > far
        resting.away = resting.away + 1 if is_away else 0
        if resting.away >= config.patience:
            self._resting[name] = begun
        if is_away:
            return
        resting.frames += 1
        for each in resting.ways:
            each.weight, each.unseen = each.weight * config.fades, each.unseen + 1
        if is_same:
            way.weight, way.unseen = way.weight + score, 0
            way.T_stage_part = _between(way.T_stage_part, T_near, score / way.weight, part)
        else:
            ways = sorted([*resting.ways, *begun.ways], key=lambda way: -way.weight)
            resting.ways = ways[:MOST]

    def _is_there(self, resting: _Resting) -> bool:
        """Whether enough frames found a part there, and the last that found it did."""
        return not resting.away and resting.frames >= self._config.enough

    def _is_known(self, resting: _Resting) -> bool:
        """Whether it is known how a part lies."""
        config, told = self._config, resting.told
        share = told.weight / sum(way.weight for way in resting.ways)
        is_enough = resting.frames >= config.enough and share >= config.share
        return is_enough and told.unseen <= config.lately

    def _is_otherwise(self, part: Part, T_found: Transform, T_rests: Transform) -> bool:
        config = self._config
        if point_distance(T_found, T_rests, part.middle) >= config.otherwise:
            return True
        turn = symmetric_angle(T_found, T_rests, part.symmetries)
        return turn >= math.radians(config.otherwise_deg)


def _box(part: Part) -> Points:
    """The corners of the part's box, in its frame."""
    low, high = part.mesh.vertices.min(axis=0), part.mesh.vertices.max(axis=0)
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), axis=-1)
    return corners.reshape(8, 3)


def _nearest(
    resting: _Resting, T_stage_part: Transform, part: Part
) -> tuple[_Way, Transform, float]:
    """The way to which a pose is nearest, that pose as it looks the same there, and the turn between."""
    found: list[tuple[_Way, Transform, float]] = []
    for way in resting.ways:
        T_near = nearest_symmetric(T_stage_part, way.T_stage_part, part.symmetries)
        found.append((way, T_near, rotation_angle(way.T_stage_part[:3, :3].T @ T_near[:3, :3])))
    return min(found, key=lambda way: way[2])


def _between(T_from: Transform, T_to: Transform, share: float, part: Part) -> Transform:
    """The pose that far on the way from one to another that is near."""
    mixed = (1 - share) * T_from[:3, :3] + share * T_to[:3, :3]
    R = orthonormalized(transform_from(mixed, np.zeros(3)))[:3, :3]
    middle = (1 - share) * apply_to_point(T_from, part.middle) + share * apply_to_point(
        T_to, part.middle
    )
    return transform_from(R, middle - R @ part.middle)
