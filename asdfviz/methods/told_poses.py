"""Poses as they are told: mended by how parts would look where they lie and sit; nothing goes on from there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol, runtime_checkable

from asdfviz.datatypes import Assembly, Frame, PoseEstimate, State
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.joint_turns import JointTurns, JointTurnsConfig
from asdfviz.methods.lying import Lying, LyingConfig
from asdfviz.methods.on_table import OnTableConfig
from asdfviz.methods.part_poses import PartShape
from asdfviz.methods.seen_smear import SeenSmear, SmearConfig

SURE = 0.5
"""Least score of a pose from which the smear is seen."""


@runtime_checkable
class TellsPoses(Protocol):
    """Options of a method that tells poses so."""

    @property
    def at_rest(self) -> AtRestConfig:
        """What lies still."""
        ...

    @property
    def laid(self) -> OnTableConfig:
        """What the table does to all poses, first."""
        ...

    @property
    def lying(self) -> LyingConfig:
        """What lies on it."""
        ...

    @property
    def joint_turns(self) -> JointTurnsConfig:
        """What turns in its joint."""
        ...

    @property
    def smear(self) -> SmearConfig:
        """How it is seen how the depth camera smears."""
        ...


class ToldPoses:
    """One for each sequence."""

    def __init__(
        self, assembly: Assembly, shapes: Mapping[str, PartShape], config: TellsPoses
    ) -> None:
        self.rest = AtRest(assembly, config=config.at_rest)
        """Has to see a frame's poses before they are told."""
        self.smear = SeenSmear(assembly.parts, config=config.smear)
        """What parts that lie show of the depth camera's."""
        self._lying = Lying(
            assembly, shapes, laid=config.laid, config=config.lying, smear=self.smear
        )
        self._joint_turns = JointTurns(
            assembly, shapes, config=config.joint_turns, smear=self.smear
        )

    def step(
        self, poses: Mapping[str, PoseEstimate], frame: Frame, state: State | None
    ) -> dict[str, PoseEstimate]:
        """The poses as they are told.

        Args:
            poses: of the parts; those that the state joins are of stage `group`.
            frame: that they are of; without depth nothing changes.
            state: that joins them, if one is known.
        """
        # Joined to a base that is hidden it hangs in the air all the same.
        joined = () if state is None else state.T_base_part
        lying = self._lying.step(self.rest.told(poses), frame, joined=joined)
        loose = {n: p.T_camera_part for n, p in lying.items() if _is_sure_and_loose(p)}
        self.smear.see(frame, loose)
        return self._joint_turns.step(lying, frame, state)

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self.rest.rename(names)
        self._lying.rename(names)
        self._joint_turns.rename(names)


def _is_sure_and_loose(pose: PoseEstimate) -> bool:
    return pose.stage != "group" and pose.score >= SURE
