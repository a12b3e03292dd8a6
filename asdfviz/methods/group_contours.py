"""Joined parts settled as one: their contours and depth together, with the freedoms of their joints.

Not in the paper. What one part leaves open the others tell, and where a joint lets a part move, that is
looked for in the picture instead of taken from the part's own pose.
"""

from __future__ import annotations

from collections.abc import Mapping

from asdfviz.datatypes import Camera, Frame, Joint, State
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import point_distance, rotation_angle
from asdfviz.methods.contour_fits import ContourConfig
from asdfviz.track.bodies import Body
from asdfviz.track.confidence import Evidence
from asdfviz.track.tracker import Tracker

STILL = 0.002
"""A group has not moved whose base is proposed nearer than this to where it was settled, metres,"""
STILL_TURN = 0.05
"""and turned by less than this, radians, if what it shows there fits as before."""
SLACK = 0.97
"""A settled group must fit nearly as well as before by the trackers' plain questions, which tell
parts in place from lost ones and hardly millimetres."""
SEEN = 0.3
"""Visible share of a part from which depth is asked whether it is there."""


class GroupContours:
    """Settles the group of one sequence."""

    def __init__(
        self, bodies: Mapping[str, Body], camera: Camera, *, base: str, config: ContourConfig
    ) -> None:
        self._config, self._base = config, base
        self._centre = bodies[base].model.centre
        self._tracker = Tracker(bodies, camera, config.tracker)
        self._settled: dict[str, Transform] = {}
        """Where the group was settled last,"""
        self._joined: dict[str, tuple[bytes, Joint | None]] = {}
        """where the state of then has its parts, and by what joints,"""
        self._fitted = 0.0
        """how well it fitted there,"""
        self._times = 0
        """in so many frames one after another,"""
        self._frames = 0
        """and so many frames ago."""
        self.fits: dict[str, float] = {}
        """Of the parts of the group that are seen, as told last: the share of the depth readings on each
        that are on its surface, 0 to 1."""

    def step(
        self, frame: Frame, poses: Mapping[str, Transform], state: State
    ) -> dict[str, Transform]:
        """Poses T_camera_part of a group, settled; nothing where that fits the picture no better.

        Args:
            frame: with depth, or nothing is said.
            poses: of the base and of what is joined to it.
            state: that joins them; other parts that it joins are left out.
        """
        self.fits = {}
        if frame.depth is None or self._base not in poses:
            return {}
        joined = {
            n: (T.tobytes(), state.joints.get(n))
            for n, T in state.T_base_part.items()
            if n in poses
        }
        if joined != self._joined:  # what another state made of the group says nothing
            self._settled, self._joined = {}, joined
        if self._rests(frame, poses):
            return dict(self._settled)
        settled = self._moved(frame, poses, state)
        self._times = self._times + 1 if self._is_still(settled) else 0
        self._settled, self._frames = settled, 0
        return settled

    def _rests(self, frame: Frame, poses: Mapping[str, Transform]) -> bool:
        """Whether the group was settled often enough where it still is."""
        self._frames += 1
        if not self._config.rests(self._times, self._frames) or not self._is_still(poses):
            return False
        self._tracker.replace(frame, self._settled)
        evidence = self._tracker.evidence(frame)
        self.fits = _fits(evidence)
        return self._value(evidence) > SLACK * self._fitted

    def _is_still(self, poses: Mapping[str, Transform]) -> bool:
        """Whether the base is where it was settled, with the same parts as then."""
        if self._settled.keys() != poses.keys() or not poses:
            return False
        T, T_settled = poses[self._base], self._settled[self._base]
        return (
            point_distance(T, T_settled, self._centre) < STILL
            and rotation_angle(T[:3, :3].T @ T_settled[:3, :3]) < STILL_TURN
        )

    def _moved(
        self, frame: Frame, poses: Mapping[str, Transform], state: State
    ) -> dict[str, Transform]:
        tracker = self._tracker
        tracker.drop([name for name in tracker.names if name not in poses])
        tracker.add(frame, {n: T for n, T in poses.items() if n not in tracker.names})
        tracker.replace(frame, poses)
        tracker.hold(state, base=self._base)
        before = self._value(tracker.evidence(frame))
        tracker.move(frame)
        evidence, settled = tracker.evidence(frame), tracker.poses
        moved = point_distance(settled[self._base], poses[self._base], self._centre)
        is_near = moved <= self._config.farthest
        value = self._value(evidence)
        if not is_near or value <= SLACK * before:
            tracker.drop(tracker.names)  # its colours may be those of something else
            return {}
        sure = [n for n, e in evidence.items() if tracker.judged(e) >= self._config.sure]
        tracker.learn(frame, sure)
        self._fitted, self.fits = value, _fits(evidence)
        return settled

    def _value(self, evidence: Mapping[str, Evidence]) -> float:
        """How well the group fits; parts count by what is seen of them."""
        return sum(e.visible * self._tracker.judged(e) for e in evidence.values())


def _fits(evidence: Mapping[str, Evidence]) -> dict[str, float]:
    return {n: e.fit for n, e in evidence.items() if e.measured and e.visible >= SEEN}
