"""Poses of parts that lie on the table, as they are told: the one that looks most like what is seen.

Not in the paper. What lies on a table stands on one of few sides, so only its place on the table and its
turn there are open, and a tilted pose that contours and depth settled in between is none of them. Each
part is drawn on the sides and in the turns that are near, and the best are refined by how they would
look. Nothing is turned end for end here, and no tracker goes on from these poses.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from asdfviz.datatypes import Assembly, Frame, Part, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Scores, Transform, Vector
from asdfviz.geometry.symmetry import nearest_symmetric
from asdfviz.geometry.transforms import (
    inverse,
    point_distance,
    rotation_angle,
)
from asdfviz.methods.drawn_looks import DrawnConfig, drawn_looks
from asdfviz.methods.lying_climb import COARSE_PX, climbed, coarse, spun
from asdfviz.methods.on_table import OnTableConfig, on_table
from asdfviz.methods.part_poses import PartShape, shape_fit
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.methods.seen_table import table_near
from asdfviz.pose.standing import height_above, sides, standing_on
from asdfviz.pose.table import Table
from asdfviz.state.twins import renamed
from asdfviz.track.confidence import HIDDEN_BY

TURNS_DEG = (-30.0, 0.0, 30.0)
"""In which a part is drawn on each of its sides."""
ALIKE = 0.99
"""Cosine from which two sides are tried as one: the nearer one."""


@dataclass(frozen=True)
class LyingConfig:
    """When a told pose is replaced by one that lies on the table; the paper has no such step."""

    enabled: bool = True
    """On or off."""
    near: float = 0.012
    """A part lies on the table whose lowest corner is nearer to it than this, metres."""
    tilt_deg: float = 50.0
    """Sides that are turned from it by no more than this are tried,"""
    sides: int = 5
    """so many at most, the nearest."""
    turned_deg: float = 65.0
    """No pose is turned by more than this in all."""
    refined: int = 1
    """Of the poses that are drawn so many are refined."""
    ahead: float = 0.06
    """So much more like what is seen the best one must look, in units of `turns.drawn`."""
    every: int = 2
    """In one of so many frames a part is looked at,"""
    again: int = 30
    """and one that lies still after so many frames again,"""
    doubted: int = 4
    """but after so many once it was seen for the first time, or otherwise: two looks must agree,"""
    agree_deg: float = 20.0
    """up to this."""
    visible: float = 0.5
    """Share of the part that nothing may hide, 0 to 1."""
    still: float = 0.002
    """It lies still that moved by no more than this since then, metres,"""
    still_deg: float = 6.0
    """and turned by no more than this."""
    side_px: float = COARSE_PX
    """Parts that look larger are compared in a picture of half the size, or a quarter,"""
    least_deg: float = 10.0
    """and keep their pose where it would be turned by less: contours tell it better then."""
    carried: int = 24
    """For so many frames after a look one that moves, or is seen by a camera that moves, is told as much
    otherwise as it was then."""
    drawn: DrawnConfig = field(default_factory=DrawnConfig)
    """By what poses are compared."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.sides, self.refined, self.every, self.again, self.doubted) < 1:
            raise MethodError(
                f"lying.sides is {self.sides}, refined {self.refined}, every {self.every}, again "
                f"{self.again} and doubted {self.doubted}: use 1 or more"
            )


@dataclass(frozen=True, slots=True, eq=False)
class _Looked:
    """What was found of a part."""

    frame: int
    """When, by the number of the step."""
    T_camera_part: Transform
    """The pose that it had then."""
    T_part_lying: Transform | None
    """From there to the one that looks more like what was seen; None where none does."""
    is_sure: bool
    """Whether two looks in a row said so."""
    is_doubted: bool = True
    """Whether another look is to come soon: the last one was the first, or said otherwise."""


class Lying:
    """Poses as they are told, of one sequence."""

    def __init__(
        self,
        assembly: Assembly,
        shapes: Mapping[str, PartShape],
        *,
        laid: OnTableConfig,
        config: LyingConfig,
        smear: SeenSmear | None = None,
    ) -> None:
        """Begin a sequence.

        Args:
            assembly: whose parts.
            shapes: of the parts.
            laid: what the table does to all poses, before.
            config: when one is replaced.
            smear: what is seen of the depth camera's.
        """
        self._assembly, self._shapes, self._laid, self._config = assembly, shapes, laid, config
        self._smear = smear
        self._looked, self._step = dict[str, _Looked](), 0

    def step(
        self, poses: Mapping[str, PoseEstimate], frame: Frame, *, joined: Collection[str] = ()
    ) -> dict[str, PoseEstimate]:
        """The poses, those of loose parts other than the base that lie on the table as they lie there."""
        free = {name: pose for name, pose in poses.items() if name not in joined}
        laid = on_table(free, self._assembly, self._shapes, frame, config=self._laid)
        told = {**poses, **laid}
        config = self._config
        if not config.enabled or frame.depth is None:
            return told
        self._step += 1
        base = self._assembly.base
        loose = {
            name: self._as_looked(name, pose.T_camera_part)
            for name, pose in laid.items()
            if pose.stage != "group" and name != base
        }
        still = {name for name, T in loose.items() if self._is_still(name, T)}
        due = [name for name in loose if self._is_due(name, name in still)]
        due.sort(key=lambda name: -self._overdue(name, name in still))
        if due and self._step % config.every == 0:
            part = self._assembly.parts[due[0]]
            self._looked[part.name] = self._look(part, loose[part.name], frame)
        for name, T in loose.items():
            looked = self._looked.get(name)
            if looked is None or looked.T_part_lying is None or not looked.is_sure:
                continue
            # What lies still is told so, whatever its own pose does meanwhile.
            T_from = looked.T_camera_part if name in still else T
            if self._age(name) <= (2 * config.again if name in still else config.carried):
                told[name] = replace(told[name], T_camera_part=T_from @ looked.T_part_lying)
        return told

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._looked = renamed(self._looked, names)

    def _is_due(self, name: str, is_still: bool) -> bool:
        return not is_still or self._overdue(name, is_still) >= 1

    def _overdue(self, name: str, is_still: bool) -> float:
        """How old the last look is, in times after which a part is looked at again: one that moves as
        often as one that is doubted, or it would leave no look for others."""
        looked, config = self._looked.get(name), self._config
        is_settled = is_still and looked is not None and not looked.is_doubted
        return self._age(name) / (config.again if is_settled else config.doubted)

    def _look(self, part: Part, T_now: Transform, frame: Frame) -> _Looked:
        """How a part lies, and whether that was found before."""
        before, lying = self._looked.get(part.name), self._lying(part, T_now, frame)
        if before is None:
            return _Looked(self._step, T_now, lying, is_sure=False)
        is_still = self._is_still(part.name, T_now)
        if self._agrees(before, T_now, lying, is_still):
            return _Looked(self._step, T_now, lying, is_sure=True, is_doubted=False)
        if is_still and before.is_sure and not before.is_doubted:  # a single look may err
            return replace(before, frame=self._step, is_doubted=True)
        return _Looked(self._step, T_now, lying, is_sure=False)

    def _agrees(
        self, before: _Looked, T_now: Transform, lying: Transform | None, is_still: bool
    ) -> bool:
        """Whether a look says what the one before said."""
        if lying is None or before.T_part_lying is None:
            return lying is before.T_part_lying
        if is_still:
            R_before = (before.T_camera_part @ before.T_part_lying)[:3, :3]
            R_lying = (T_now @ lying)[:3, :3]
        else:  # seen by a camera that moves: it is as much otherwise as it was
            R_before, R_lying = before.T_part_lying[:3, :3], lying[:3, :3]
        return rotation_angle(R_before.T @ R_lying) <= math.radians(self._config.agree_deg)

    def _age(self, name: str) -> int:
        """Frames since a part was looked at, very many if it never was."""
        return self._step - self._looked[name].frame if name in self._looked else 1 << 30

    def _as_looked(self, name: str, T_camera_part: Transform) -> Transform:
        """Of the poses that look the same the one nearest to that in which the part was looked at."""
        looked, part = self._looked.get(name), self._assembly.parts[name]
        if looked is None:
            return T_camera_part
        return nearest_symmetric(T_camera_part, looked.T_camera_part, part.symmetries)

    def _is_still(self, name: str, T_camera_part: Transform) -> bool:
        """Whether a part lies where it was looked at."""
        looked, config = self._looked.get(name), self._config
        if looked is None:
            return False
        T, middle = looked.T_camera_part, self._assembly.parts[name].middle
        turned = rotation_angle(T[:3, :3].T @ T_camera_part[:3, :3])
        is_near = point_distance(T, T_camera_part, middle) <= config.still
        return is_near and turned <= math.radians(config.still_deg)

    def _lying(self, part: Part, T_now: Transform, frame: Frame) -> Transform | None:
        """From a pose to the one near it that looks more like what is seen, lying on the table."""
        corners, config = self._shapes[part.name].corners, self._config
        box = projected_box(T_now, corners, frame)
        table = table_near(frame, box)
        if table is None:
            return None
        if abs(height_above(T_now, corners, table)) > config.near:
            return None
        tried, seen = self._tried(part, T_now, table), coarse(frame, box, side_px=config.side_px)
        if not tried:
            return None
        looks = self._looks(part, tried, table, seen)
        if looks is None:
            return None
        best = [int(k) for k in np.argsort(-looks)[: config.refined]]
        refined = [self._refined(part, tried[k], table, seen) for k in best]
        both = [T_now, *refined]
        looks = self._looks(part, both, table, seen)
        if looks is None:
            return None
        turned = np.rad2deg([rotation_angle(T_now[:3, :3].T @ T[:3, :3]) for T in both])
        looks[turned > config.turned_deg] = -np.inf
        if seen is not frame:
            looks[1:][turned[1:] < config.least_deg] = -np.inf
        k = int(looks.argmax())
        is_ahead = looks[k] > looks[0] + config.ahead
        if not is_ahead or not self._is_in_view(part.name, both[k], frame):
            return None
        return inverse(T_now) @ both[k]

    def _is_in_view(self, name: str, T_camera_part: Transform, frame: Frame) -> bool:
        # A smeared rim is millimetres nearer than what it surrounds, and hides nothing.
        fit = shape_fit(T_camera_part, self._shapes[name], frame, margin=HIDDEN_BY)
        return fit is not None and fit.visible >= self._config.visible

    def _tried(self, part: Part, T_now: Transform, table: Table) -> list[Transform]:
        """The part on each of the sides that are near, in several turns."""
        corners, downs = self._shapes[part.name].corners, sides(part.mesh)
        stood = [(standing_on(T_now, down, corners, table), down) for down in downs]
        near = [(one, down) for one, down in stood if one is not None]
        found, chosen = list[Transform](), list[Vector]()
        for (T, tilt), down in sorted(near, key=lambda stood: stood[0][1]):
            is_other = all(down @ other < ALIKE for other in chosen)
            if len(chosen) == self._config.sides:
                break
            if tilt <= np.deg2rad(self._config.tilt_deg) and is_other:
                chosen.append(down)
                found += [spun(T, part.middle, table, np.deg2rad(turn)) for turn in TURNS_DEG]
        return found

    def _refined(self, part: Part, T: Transform, table: Table, frame: Frame) -> Transform:
        """Uphill by how the pose would look."""
        looks_of = partial(self._looks, part, table=table, frame=frame)
        return climbed(T, looks_of, middle=part.middle, table=table)

    def _looks(
        self, part: Part, Ts: Sequence[Transform], table: Table, frame: Frame
    ) -> Scores | None:
        """How much like what is seen each pose would look; None where that is unknown."""
        config, now = self._config.drawn, self._smear and self._smear.now
        return drawn_looks(frame, part.mesh, np.stack(Ts), table=table, config=config, smear=now)
