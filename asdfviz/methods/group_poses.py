"""State helps pose: parts that the state joins get their pose from the group.

The paper claims it and gives no formula; this one is ours. Every joined part with a pose says where
the base would be; the base pose on which the parts and the depth image agree best is taken. A part
without a pose of its own then gets the one that the state gives it, a joint where the part was last
seen in it; a part with one changes to it only where depth agrees with it better. What is hidden there,
by a hand or by other parts, speaks neither for it nor against it. What the state is not sure of stays as
it was, and absent if it was absent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State, StateEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import inverse
from asdfviz.methods.loose_twins import by_count
from asdfviz.methods.part_poses import PartShape, shape_fit
from asdfviz.methods.pooled_keypoints import PooledBase
from asdfviz.pose.depth_fit import DepthFit, share_of_all, share_shown
from asdfviz.state.joint_places import JointPlaces, JointPlacesConfig
from asdfviz.state.joints import Deviation, off_place
from asdfviz.state.place_odds import JoinedOdds
from asdfviz.state.twins import renamed_poses, twin_groups, twins_by_name


@dataclass(frozen=True)
class GroupConfig:
    """When parts are placed by the state; the paper gives none of the numbers."""

    enabled: bool = True
    """State helps pose, on or off."""
    pooled: bool = True
    """Whether the keypoints of all joined parts together say where the base is, where they give first poses."""
    certain: float = 0.6
    """Least probability of all states together that have the part where it is put."""
    distance: float = 0.02
    """A pose farther from its joined place disagrees with the state, metres."""
    angle_deg: float = 30.0
    """And one turned farther, degrees; symmetric poses count as the same."""
    margin: float = 0.008
    """Depth readings this near to the surface agree with it, metres."""
    gain: float = 0.1
    """A pose is replaced where the group's agrees with this much more of the depth readings."""
    doubt: float = 0.15
    """One that disagrees with the state is replaced even where the group's agrees with less of the
    readings, by up to this: a part turned by half may fit as well by chance."""
    settled: float = 0.6
    """Probability from which a pose elsewhere is not believed at all, since the part cannot be in
    two places, and one in its place is replaced where the group's agrees as well."""
    surer: float = 0.3
    """A pose whose score is higher by this than that of the pose that places the group stays, unless
    it is not believed at all; one whose score is lower by this is in doubt, once its place is settled."""
    least_fit: float = 0.15
    """A group pose that agrees with less of the depth readings is not taken."""
    hidden: float = 0.4
    """Of one that shows less than this share of its surface only that counts, if its place is settled and
    the part was not found, or only where none of its twins can be (`loose_twins`)."""

    def __post_init__(self) -> None:
        """Raise a MethodError where a share or probability is none."""
        for name in ("certain", "settled", "least_fit", "hidden"):
            if not 0 <= getattr(self, name) <= 1:
                raise MethodError(f"group.{name} is {getattr(self, name):g}, use 0 to 1")


class GroupPoses:
    """Places joined parts; remembers where they were seen in their joints."""

    def __init__(
        self, assembly: Assembly, shapes: Mapping[str, PartShape], *, config: GroupConfig
    ) -> None:
        self.assembly, self.shapes, self._config = assembly, shapes, config
        near = JointPlacesConfig(distance=config.distance, angle_deg=config.angle_deg)
        self.places = JointPlaces(assembly, config=near)
        """Where parts were last seen in their joints."""
        self._odds = JoinedOdds(assembly)
        self._held: tuple[str, ...] = ()
        self._twins = twins_by_name(assembly)
        self._groups = twin_groups(assembly)

    @property
    def held(self) -> tuple[str, ...]:
        """The base and the parts that were in their places in the last frame."""
        return self._held

    def see(self, T_camera_base: Transform, poses: Mapping[str, PoseEstimate]) -> None:
        """Remember the joints of parts that somebody saw in them."""
        self.places.see(T_camera_base, poses)

    def step(
        self,
        poses: Mapping[str, PoseEstimate],
        state: StateEstimate | None,
        frame: Frame,
        *,
        base: PoseEstimate | None = None,
        may_be: Callable[[Transform], bool] | None = None,
        pooled: PooledBase | None = None,
    ) -> dict[str, PoseEstimate]:
        """Return the poses, those of joined parts by the group where it knows better.

        Args:
            poses: of the parts, each by itself.
            state: which parts are joined, and how surely.
            frame: with depth, or no pose is judged by it.
            base: where the base is by all that is seen of the group, if that is known.
            may_be: whether it may be there at all, if that is known.
            pooled: where it is by the keypoints of given parts, if those give first poses.
        """
        result, self._held = dict(poses), ()
        if state is None:
            return result
        joined, sure = self._joined(state)
        if not joined:
            return result
        named = self.assembly.states[state.index]
        found = self._base(poses, joined, named, frame, base, may_be, pooled)
        if found is None:
            return result
        T_camera_base, trust = found
        self.places.see(T_camera_base, {n: poses[n] for n in joined if n in poses})
        poses, surplus = self._by_count(poses, T_camera_base, named, sure)
        result = dict(poses)
        # A loose twin that went by a joined part's name gave it back.
        free = surplus | {name for name in (self.assembly.base, *joined) if name not in poses}
        for name in (self.assembly.base, *joined):
            placed = self._placed(name, T_camera_base, poses.get(name), named)
            own = poses.get(name)
            certain = sure.get(name, 1.0)
            found = self._seen(name, placed, frame)
            fit = share_of_all(found)
            if certain >= self._config.settled and name in free:
                fit = max(fit, share_shown(found, self._config.hidden))
            if fit < self._config.least_fit:
                continue
            if own is None or fit > self._least_to_replace(
                name, own, T_camera_base, named, frame, certain, trust
            ):
                # A root, since the three say much the same; no surer than what places it.
                score = trust * math.sqrt(certain * fit)
                result[name] = PoseEstimate(name, placed, score, "group")
        self._held = tuple(
            name
            for name in (self.assembly.base, *joined)
            if name in result and self._agrees(self._off(name, T_camera_base, result, named))
        )
        return result

    def _by_count(
        self,
        poses: Mapping[str, PoseEstimate],
        T_camera_base: Transform,
        state: State,
        sure: Mapping[str, float],
    ) -> tuple[dict[str, PoseEstimate], set[str]]:
        """The poses, loose ones by names of twins that are loose; and those of which too many were found."""
        held = [name for name, certain in sure.items() if certain >= self._config.settled]
        in_place = {self.assembly.base} | {
            n
            for n in held
            if n in poses and self._agrees(self._off(n, T_camera_base, poses, state))
        }
        scores = {name: pose.score for name, pose in poses.items()}
        changes, surplus = by_count(scores, self._groups, held, in_place)
        return renamed_poses(poses, changes), surplus

    def _joined(self, state: StateEstimate) -> tuple[list[str], dict[str, float]]:
        """Parts that are certainly where the most probable state has them, and how certainly."""
        sure = self._odds.of(state)
        joined = [
            name
            for name, probability in sure.items()
            if name != self.assembly.base and probability >= self._config.certain
        ]
        return joined, sure

    def _surely_placed(self, joined: list[str], state: State) -> dict[str, Transform]:
        """T_base_part of the base and of parts that tell where it is; those that look the same in several
        turns do not, nor those whose loose twins may bear their names while they are hidden."""
        base, parts = self.assembly.base, self.assembly.parts
        told = {
            name: self.places.last(name, state)
            for name in joined
            if set(self._twins[name]).issubset(joined) and not parts[name].symmetries.is_symmetric
        }
        return {base: np.eye(4), **told}

    def _base(
        self,
        poses: Mapping[str, PoseEstimate],
        joined: list[str],
        state: State,
        frame: Frame,
        seen: PoseEstimate | None,
        may_be: Callable[[Transform], bool] | None,
        pooled: PooledBase | None,
    ) -> tuple[Transform, float] | None:
        """Where the base is by most accounts, and the score of the pose that says so."""
        members = [name for name in (self.assembly.base, *joined) if name in poses]
        accounts: list[tuple[Transform, float]] = []
        doubtful: list[tuple[Transform, float]] = []
        surely = self._surely_placed(joined, state)
        for name in members:
            if self.assembly.parts[name].symmetries.is_symmetric and name != self.assembly.base:
                continue  # it may be turned, and the base with it
            T_base_part = self.places.last(name, state)
            account = poses[name].T_camera_part @ inverse(T_base_part), poses[name].score
            if may_be is None:
                (accounts if name in surely else doubtful).append(account)
            elif may_be(account[0]):
                accounts.append(account)
        by_all = pooled(surely) if pooled is not None and self._config.pooled else None
        accounts += [(told.T_camera_part, told.score) for told in (seen, by_all) if told]
        best: tuple[float, Transform, float] | None = None
        for T_camera_base, score in accounts or doubtful:
            support = sum(
                poses[other].score * self._bell(self._off(other, T_camera_base, poses, state))
                for other in members
            )
            for other in (self.assembly.base, *joined):
                placed = self._placed(other, T_camera_base, poses.get(other), state)
                support += self._fit(other, placed, frame)
            if best is None or support > best[0]:
                best = (support, T_camera_base, score)
        return None if best is None else (best[1], best[2])

    def _placed(
        self, name: str, T_camera_base: Transform, own: PoseEstimate | None, state: State
    ) -> Transform:
        """T_camera_part as the state has it; in a joint as near to the part's own pose as it lets."""
        T_nominal, joint = state.T_base_part[name], state.joints.get(name)
        if own is not None and joint is not None:
            T_own = inverse(T_camera_base) @ own.T_camera_part
            T_near = self.places.nearest(name, T_own, T_nominal, joint)
            if T_near is not None:
                return T_camera_base @ T_near
        return T_camera_base @ self.places.last(name, state)

    def _least_to_replace(
        self,
        name: str,
        own: PoseEstimate,
        T_camera_base: Transform,
        state: State,
        frame: Frame,
        certain: float,
        trust: float,
    ) -> float:
        """The fit above which the group's pose is to replace the part's own."""
        T_own = inverse(T_camera_base) @ own.T_camera_part
        is_joined = self._agrees(self._off_of(name, T_own, state))
        is_settled = certain >= self._config.settled
        if is_settled and not is_joined:
            return self._config.least_fit
        if own.score >= trust + self._config.surer:
            return math.inf
        is_surer = is_settled and trust >= own.score + self._config.surer
        gain = self._config.gain * (not is_settled)
        if is_surer or not is_joined:
            gain = -self._config.doubt
        return self._fit(name, own.T_camera_part, frame) + gain

    def _off(
        self,
        name: str,
        T_camera_base: Transform,
        poses: Mapping[str, PoseEstimate],
        state: State,
    ) -> Deviation:
        return self._off_of(name, inverse(T_camera_base) @ poses[name].T_camera_part, state)

    def _off_of(self, name: str, T_base_part: Transform, state: State) -> Deviation:
        return off_place(T_base_part, self.assembly.parts[name], state)

    def _agrees(self, off: Deviation) -> bool:
        return off.within(self._config.distance, self._config.angle_deg)

    def _bell(self, off: Deviation) -> float:
        angle = off.angle / math.radians(self._config.angle_deg)
        return math.exp(-0.5 * ((off.distance / self._config.distance) ** 2 + angle**2))

    def _fit(self, name: str, T_camera_part: Transform, frame: Frame) -> float:
        return share_of_all(self._seen(name, T_camera_part, frame))

    def _seen(self, name: str, T_camera_part: Transform, frame: Frame) -> DepthFit | None:
        return shape_fit(T_camera_part, self.shapes[name], frame, margin=self._config.margin)
