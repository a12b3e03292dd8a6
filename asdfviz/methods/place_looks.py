"""What stands where a joined part would stand, asked of the crop network: a witness for the state.

Not in the paper. The state says where each part of the group is; the network that names things is shown
that place and says whether it shows the part. How much of the part it sees in an empty place depends on
what is there instead, so every place is compared with itself some frames before. Only places in which
the states that are near in the assembly's order differ are looked at.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import Assembly, Frame, PoseEstimate
from asdfviz.detector.crop_classes import class_name
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import beside, box_around, is_in_view, longer_side
from asdfviz.geometry.camera import project
from asdfviz.geometry.odds import log_odds, probability
from asdfviz.geometry.shapes import Box, Scores, Transform
from asdfviz.geometry.transforms import apply, apply_to_point
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.thing_names import namer
from asdfviz.pose.box_size import box_distance
from asdfviz.state.fusion import neighbours
from asdfviz.state.joint_places import JointPlaces

LEAST = probability(-6.0)
"""Probabilities nearer to 0 or 1 are cut, so that no log odds are beyond 6."""
LEAST_PX = 4.0
"""A place that is smaller in the picture shows nothing."""


@dataclass(frozen=True)
class PlaceLooksConfig:
    """How what the network sees in a place counts."""

    enabled: bool = True
    """Whether it is asked; only one that was taught names can be."""
    empty: float = 0.15
    """What it is expected to say of an empty place before it ever looked there, a probability."""
    jump: float = 3.0
    """Rise of its log odds that speaks neither for the part nor against it."""
    gain: float = 0.5
    """Log odds of the part per log odds of the network beyond that,"""
    most: float = 2.0
    """but no more than this"""
    least: float = -1.0
    """and no less: a part may be hidden;"""
    shown_px: float = 16.0
    """nor so much against a place whose shorter side is less than this, pixels, but only the share that
    its area has of such a square's: there the network sees nothing of the part either."""
    delay: int = 12
    """After so many frames a look at a place that is still empty is remembered as one."""
    memory: float = 0.02
    """Weight of such a look, once there were enough;"""
    enough: int = 8
    """until then all weigh the same,"""
    prior: float = 3.0
    """and what is expected before the first one as much as this many."""
    small: float = 0.02
    """Places that look smaller than this are looked at with shifts too, metres of the longer side,"""
    shift: float = 0.35
    """by this share of it: for them a slight error of the base's pose is large."""
    empty_below: float = 0.3
    """Probability of the part being joined below which its place is empty."""
    in_front: float = 0.015
    """What is nearer than the part can be by this hides it, metres."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0 < self.empty < 1 or self.delay < 1:
            raise MethodError(
                f"place_looks.empty is {self.empty:g} and place_looks.delay {self.delay}: empty "
                "must be above 0 and below 1, delay 1 or more"
            )


@dataclass(slots=True, eq=False)
class _Place:
    """Where some states have a part, and how that place looked while it was empty."""

    part: str
    states: tuple[int, ...]
    """That have it there."""
    empty: float
    """Log odds that the network gives the part in the empty place."""
    looks: int = 0
    """At the empty place."""
    recent: deque[float] = field(default_factory=deque[float])
    side_px: float = 0.0
    """Its shorter side in the last picture."""

    def remember(self, logit: float, joined: float, config: PlaceLooksConfig) -> None:
        """Take in a look; one of some frames ago counts as empty if the part is not joined yet."""
        if joined >= config.empty_below:
            self.recent.clear()
            return
        self.recent.append(logit)
        if len(self.recent) > config.delay:
            old = self.recent.popleft()
            self.looks += 1
            is_new = self.looks <= config.enough
            weight = 1 / (self.looks + config.prior) if is_new else config.memory
            self.empty += weight * (old - self.empty)


class PlaceLooks:
    """Looks at the places of joined parts in one sequence."""

    def __init__(
        self,
        assembly: Assembly,
        shapes: Mapping[str, PartShape],
        looker: object | None,
        *,
        config: PlaceLooksConfig,
    ) -> None:
        """Begin a sequence.

        Args:
            assembly: whose states.
            shapes: of the parts.
            looker: the crop network; None, and anything that names nothing, is never asked, and none
                of parts that it does not know.
            config: how its answers count.
        """
        self._looker = namer(looker) if config.enabled else None
        self._assembly, self._config = assembly, config
        known = () if self._looker is None else self._looker.classes
        classes = {name: class_name(assembly, part) for name, part in assembly.parts.items()}
        classes = {name: label for name, label in classes.items() if label in known}
        self._classes = tuple(dict.fromkeys(classes.values()))
        self._corners = {name: shape.corners for name, shape in shapes.items()}
        self._joints = JointPlaces(assembly)
        self._near = neighbours(assembly) + np.eye(len(assembly.states)) > 0
        found: dict[tuple[str, bytes], list[int]] = {}
        for state in assembly.states:
            for name, T in state.T_base_part.items():
                if name != assembly.base and name in classes:
                    found.setdefault((name, T.tobytes()), []).append(state.index)
        empty = log_odds(config.empty, least=LEAST)
        self._places = [_Place(name, tuple(states), empty) for (name, _), states in found.items()]

    def step(
        self,
        base: PoseEstimate | None,
        poses: Mapping[str, PoseEstimate],
        belief: Scores | None,
        frame: Frame,
        *,
        without: Collection[str] = (),
    ) -> Scores | None:
        """Probability of every state by what stands in its places.

        Args:
            base: where the base part is, None if that is not known.
            poses: of the parts: those that are in their joints tell how far these are.
            belief: probability of every state before this frame, None before anything was seen.
            frame: to look at.
            without: parts of which no place is looked at: they are known to be near by, and would be
                what is seen there.

        Returns:
            None where nothing could be looked at.
        """
        if self._looker is None or base is None:
            return None
        self._joints.see(base.T_camera_part, poses)
        places = [place for place in self._doubtful(belief) if place.part not in without]
        seen = self._looked(places, base.T_camera_part, frame)
        if not seen:
            return None
        # Of parts that the state joins together, one may be in its place before the others are.
        together: dict[tuple[int, ...], float] = {}
        for place, logit in seen.items():
            beyond = self._config.gain * (logit - place.empty - self._config.jump)
            least = self._config.least * min(1.0, (place.side_px / self._config.shown_px) ** 2)
            beyond = float(np.clip(beyond, least, self._config.most))
            together[place.states] = min(beyond, together.get(place.states, beyond))
            joined = 0.0 if belief is None else float(belief[[*place.states]].sum())
            place.remember(logit, joined, self._config)
        odds = np.zeros(len(self._assembly.states))
        for states, beyond in together.items():
            odds[[*states]] += beyond
        scores = np.exp(odds - odds.max())
        return scores / scores.sum()

    def _doubtful(self, belief: Scores | None) -> list[_Place]:
        """The places in which states near the most probable one differ."""
        count = len(self._assembly.states)
        near = np.ones(count, bool) if belief is None else self._near[int(belief.argmax())]
        having = [int(near[[*place.states]].sum()) for place in self._places]
        return [p for p, k in zip(self._places, having, strict=True) if 0 < k < int(near.sum())]

    def _looked(
        self, places: Sequence[_Place], T_camera_base: Transform, frame: Frame
    ) -> dict[_Place, float]:
        """Log odds that places show their parts; of those that can be seen."""
        boxes = [
            (place, box, distance)
            for place in places
            for box, distance in self._boxes(place, T_camera_base, frame)
        ]
        found: dict[_Place, float] = {}
        if boxes:
            for (place, _, _), logit in zip(boxes, self._asked(boxes, frame), strict=True):
                found[place] = max(logit, found.get(place, logit))
        return found

    def _boxes(
        self, place: _Place, T_camera_base: Transform, frame: Frame
    ) -> list[tuple[Box, float]]:
        """The place's box and distance if it is in view and nothing is in front; another one where a
        joint is known to be elsewhere than the state has it, and shifted ones of a small place."""
        state = self._assembly.states[place.states[0]]
        nominal, last = state.T_base_part[place.part], self._joints.last(place.part, state)
        wanted = [last] if np.allclose(nominal, last, atol=1e-3) else [last, nominal]
        found = [b for T in wanted for b in self._box(place.part, T_camera_base @ T, frame)]
        for box, distance in found[:1]:
            place.side_px = float((box[2:] - box[:2]).min())
            if longer_side(box) * distance / float(frame.camera.K[0, 0]) < self._config.small:
                found += [(near, distance) for near in beside(box, self._config.shift)]
        return found

    def _box(self, name: str, T: Transform, frame: Frame) -> list[tuple[Box, float]]:
        part = self._assembly.parts[name]
        corners, camera = apply(T, self._corners[name]), frame.camera
        if corners[:, 2].min() <= 0:
            return []
        box = box_around(project(corners, camera.K))
        is_large = (box[2:] - box[:2]).min() >= LEAST_PX
        if not is_large or not is_in_view(box, (camera.width, camera.height)):
            return []
        measured = None if frame.depth is None else box_distance(box, frame.depth)
        if measured is not None and measured < corners[:, 2].min() - self._config.in_front:
            return []
        return [(box, float(apply_to_point(T, part.middle)[2]))]

    def _asked(self, looked: list[tuple[_Place, Box, float]], frame: Frame) -> list[float]:
        """Log odds that each place shows its part."""
        parts = self._assembly.parts
        wanted = [class_name(self._assembly, parts[place.part]) for place, _, _ in looked]
        assert self._looker is not None
        told = self._looker.names(
            frame.rgb,
            frame.camera.K,
            [box for _, box, _ in looked],
            self._classes,
            distances=[distance for _, _, distance in looked],
        )
        return [
            log_odds(float(row[self._classes.index(name)]), least=LEAST)
            for row, name in zip(told, wanted, strict=True)
        ]


def agreed(looks: Scores | None, stands: Scores | None) -> Scores | None:
    """What two witnesses say of every state together; None where neither says anything."""
    if looks is None or stands is None:
        return stands if looks is None else looks
    both = looks * stands
    return both / both.sum()
