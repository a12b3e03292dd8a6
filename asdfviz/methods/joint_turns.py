"""Joined parts that their joints let turn are told as turned as they look most like what is seen.

Not in the paper. A tracker and contours let a knob drift about the rod that it sits on, as little of what
they compare changes with its turn. Drawn in all of its turns, it looks like what is seen in one of them,
and as it hardly turns by itself, looks at several frames add up. What hangs on one shaft is turned by one
turn, from the looks at all of it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from asdfviz.datatypes import Assembly, Frame, Joint, Part, PoseEstimate, State
from asdfviz.errors import MethodError
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Scores, Transform
from asdfviz.geometry.symmetry import symmetric_angle
from asdfviz.geometry.transforms import apply, inverse, turn_about, turns_freely
from asdfviz.methods.drawn_looks import DrawnConfig, drawn_looks
from asdfviz.methods.on_table import MARGIN
from asdfviz.methods.part_poses import PartShape, shape_fit
from asdfviz.methods.registration import projected_box
from asdfviz.methods.seen_smear import SeenSmear
from asdfviz.methods.seen_table import table_near
from asdfviz.state.joint_places import JointPlaces
from asdfviz.state.joints import nearest_turn
from asdfviz.state.twins import renamed
from asdfviz.track.confidence import HIDDEN_BY

LEAST_TURNS = 3
"""A part that looks the same after fewer steps than this is taken for round."""
MOST_ALIKE = 36
"""No part looks the same in more turns than this, unless it is round."""
SAME = 0.01
"""Poses that differ by less look the same, radians;"""
ROUND = 0.5
"""what looks the same after this is round: the turn fits into none that is whole."""
FARTHEST = 0.5 * HIDDEN_BY
"""A part sweeps farther than this, metres, whose turns cannot be compared: where it is not is taken for
something before it."""
PROBES = 300
"""Points of the surface by which that is asked."""


@dataclass(frozen=True)
class JointTurnsConfig:
    """When a joined part is told turned otherwise; the paper has no such step."""

    enabled: bool = True
    """On or off."""
    step_deg: float = 10.0
    """Between the turns that are drawn."""
    every: int = 3
    """In one of so many frames one part is looked at;"""
    fresh: int = 4
    """in every one, one that was looked at fewer times."""
    kept: float = 0.85
    """So much of what earlier looks said counts at the next one."""
    enough: int = 2
    """Fewer looks say nothing."""
    ahead: float = 0.1
    """So much more the best turn must look like what was seen than the part's own, all looks together, in
    units of `drawn`."""
    visible: float = 0.5
    """Share of the part that nothing may hide, 0 to 1."""
    drawn: DrawnConfig = field(default_factory=DrawnConfig)
    """By what turns are compared."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 1 <= self.step_deg <= 60:
            raise MethodError(f"joint-turns.step-deg is {self.step_deg:g}: use 1 to 60 degrees")
        if min(self.every, self.enough) < 1 or self.fresh < 0:
            raise MethodError(
                f"joint-turns.every is {self.every}, enough {self.enough} and "
                f"fresh {self.fresh}: use 1 or more, fresh 0 or more"
            )
        if not 0 <= self.kept <= 1:
            raise MethodError(f"joint-turns.kept is {self.kept:g}: use 0 to 1")


@dataclass(slots=True, eq=False)
class _Seen:
    """What was seen of the turn of one part in one joint."""

    T_nominal: Transform
    """Where it was in it, T_base_part."""
    joint: Joint
    step: float
    """Between the turns, radians."""
    looks: Scores
    """Of each turn, how much like what is seen it looks, over time."""
    count: int = 0
    frame: int = -1
    """Of the last look, by the number of the step."""


class JointTurns:
    """The turns of the joined parts of one sequence."""

    def __init__(
        self,
        assembly: Assembly,
        shapes: Mapping[str, PartShape],
        *,
        config: JointTurnsConfig,
        smear: SeenSmear | None = None,
    ) -> None:
        self._assembly, self._shapes, self._config = assembly, shapes, config
        self._smear = smear
        self._places = JointPlaces(assembly)
        self._seen: dict[str, _Seen] = {}
        self._step = 0

    def step(
        self, poses: Mapping[str, PoseEstimate], frame: Frame, state: State | None
    ) -> dict[str, PoseEstimate]:
        """The poses, those of joined parts turned in their joints as they look most like what is seen.

        Args:
            poses: of the parts; those of stage `group` count as joined.
            frame: with depth, or nothing changes.
            state: that joins them.
        """
        told, base = dict(poses), poses.get(self._assembly.base)
        if not self._config.enabled or frame.depth is None or state is None or base is None:
            return told
        self._step += 1
        own = {
            name: inverse(base.T_camera_part) @ poses[name].T_camera_part
            for name in self._turning(poses, state)
        }
        # What a hand hides for a while is as it was; what was seen elsewhere meanwhile is not.
        hidden = {name: seen for name, seen in self._seen.items() if name not in poses}
        self._seen = hidden | {name: self._known(name, state) for name in own}
        fresh = [name for name in own if self._seen[name].count < self._config.fresh]
        asked = list(own) if self._step % self._config.every == 0 else fresh
        if asked:
            name = min(asked, key=lambda name: self._seen[name].frame)
            self._look(name, base.T_camera_part, own[name], frame)
        for names in self._places.together(state):
            turn = self._turn({name: own[name] for name in names if name in own})
            for name in self._following(names, poses, state) if turn is not None else ():
                T_base_part = inverse(base.T_camera_part) @ poses[name].T_camera_part
                T_camera_part = base.T_camera_part @ turn @ T_base_part
                told[name] = replace(told[name], T_camera_part=T_camera_part)
        return told

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._seen = renamed(self._seen, names)

    def _turning(self, poses: Mapping[str, PoseEstimate], state: State) -> list[str]:
        """Joined parts that their joints let turn, and that look otherwise then."""
        found: list[str] = []
        for name, joint in state.joints.items():
            pose = poses.get(name)
            if pose is None or pose.stage != "group":
                continue
            turns = joint.kind in ("revolute", "cylindrical") and turns_freely(joint.turn)
            if turns and self._turns(name, joint, state.T_base_part[name]) >= LEAST_TURNS:
                found.append(name)
        return found

    def _following(
        self, names: Sequence[str], poses: Mapping[str, PoseEstimate], state: State
    ) -> list[str]:
        """Those of joined parts that turn as one, without round ones, which look the same."""
        joined = [name for name in names if name in poses and poses[name].stage == "group"]
        parts, places = self._assembly.parts, state.T_base_part
        return [n for n in joined if _period(parts[n], state.joints[n], places[n].tobytes()) > 0]

    def _known(self, name: str, state: State) -> _Seen:
        """What was seen of a part where the state has it."""
        T_nominal, joint, known = state.T_base_part[name], state.joints[name], self._seen.get(name)
        if known is not None and known.joint is joint and (known.T_nominal == T_nominal).all():
            return known
        turns = self._turns(name, joint, T_nominal)
        period = _period(self._assembly.parts[name], joint, T_nominal.tobytes())
        return _Seen(T_nominal, joint, period / turns, np.zeros(turns))

    def _turns(self, name: str, joint: Joint, T_nominal: Transform) -> int:
        """Number of turns in which a part is drawn, until it looks as before; 0 where none are compared."""
        part, key = self._assembly.parts[name], T_nominal.tobytes()
        if _sweep(part, joint, key) > FARTHEST:
            return 0
        return round(float(np.rad2deg(_period(part, joint, key))) / self._config.step_deg)

    def _look(
        self, name: str, T_camera_base: Transform, T_base_part: Transform, frame: Frame
    ) -> None:
        """Compare the part in all of its turns with what is seen."""
        seen, shape = self._seen[name], self._shapes[name]
        seen.frame = self._step
        fit = shape_fit(T_camera_base @ T_base_part, shape, frame, margin=MARGIN)
        if fit is None or fit.visible < self._config.visible:
            return
        own = self._angle(seen, T_base_part)
        turned = [
            T_camera_base @ _turned(seen.joint, k * seen.step - own) @ T_base_part
            for k in range(len(seen.looks))
        ]
        box = projected_box(turned[0], shape.corners, frame)
        looks = drawn_looks(
            frame,
            self._assembly.parts[name].mesh,
            np.stack(turned),
            table=table_near(frame, box),
            config=self._config.drawn,
            smear=self._smear and self._smear.now,
        )
        if looks is not None:
            seen.looks = self._config.kept * seen.looks + looks - looks.mean()
            seen.count += 1

    def _turn(self, own: Mapping[str, Transform]) -> Transform | None:
        """By what parts that turn as one (T_base_part) are to be turned in the base's frame; None where
        they are right, or it is not known."""
        known = [name for name in own if self._seen[name].count >= self._config.enough]
        if not known:
            return None
        finest = min((self._seen[name] for name in known), key=lambda seen: seen.step)
        looks, at = self._turns_liked({name: own[name] for name in known}, finest.step)
        k = int(looks.argmax())
        before, here, after = (float(looks[(k + d) % len(looks)]) for d in (-1, 0, 1))
        bend = before - 2 * here + after
        between = 0.5 * (before - after) / bend if bend < 0 else 0.0
        if here - _between(looks, at) <= self._config.ahead:
            return None
        return _turned(finest.joint, (k + between - at) * finest.step)

    def _turns_liked(self, own: Mapping[str, Transform], step: float) -> tuple[Scores, float]:
        """How much like what is seen parts look in every turn that they share, and in which they are.

        Both in steps, counted from where the first one is nominal.
        """
        angles = {name: self._angle(self._seen[name], T) for name, T in own.items()}
        first = next(iter(angles.values()))
        folds = [
            round(2 * np.pi / (self._seen[name].step * len(self._seen[name].looks))) for name in own
        ]
        count = round(2 * np.pi / math.gcd(*folds) / step)
        looks = np.zeros(count)
        for name, angle in angles.items():
            seen = self._seen[name]
            ats = np.arange(count) * (step / seen.step) + (angle - first) / seen.step
            looks += [_between(seen.looks, at) for at in ats]
        return looks, first / step

    def _angle(self, seen: _Seen, T_base_part: Transform) -> float:
        """How far a part is turned from its nominal pose, radians."""
        return nearest_turn((T_base_part @ inverse(seen.T_nominal))[:3, :3], seen.joint)


def _between(looks: Scores, at: float) -> float:
    """Of a turn between two that were drawn, in steps."""
    low = math.floor(at)
    share = at - low
    return float((1 - share) * looks[low % len(looks)] + share * looks[(low + 1) % len(looks)])


def _turned(joint: Joint, angle: float) -> Transform:
    return turn_about(joint.axis, joint.origin, angle)


@lru_cache(maxsize=256)
def _period(part: Part, joint: Joint, nominal: bytes) -> float:
    """How far a part in a joint turns until it looks as before, radians; 0 where it is round."""
    T_nominal = np.frombuffer(nominal).reshape(4, 4)

    def is_same(angle: float) -> bool:
        T = _turned(joint, angle) @ T_nominal
        return symmetric_angle(T, T_nominal, part.symmetries) < SAME

    if is_same(ROUND):
        return 0.0
    return next(2 * np.pi / n for n in range(MOST_ALIKE, 0, -1) if is_same(2 * np.pi / n))


@lru_cache(maxsize=256)
def _sweep(part: Part, joint: Joint, nominal: bytes) -> float:
    """How far from where a part was nine tenths of its surface stay however it turns, metres."""
    T_nominal = np.frombuffer(nominal).reshape(4, 4)
    points = apply(T_nominal, surface_points(part.mesh.vertices, part.mesh.faces, PROBES))
    swept = [0.0]
    for share in (0.25, 0.5, 0.75):
        turned = apply(_turned(joint, share * _period(part, joint, nominal)), points)
        apart = np.linalg.norm(turned[:, None] - points[None], axis=2).min(axis=1)
        swept.append(float(np.percentile(apart, 90)))
    return max(swept)
