"""The network's term of the state, S_DL: from state boxes as in the paper, or from a crop about the base.

The crop is ours: a state box must be found and told from all others in the whole picture, while the
crop network looks where the base part is known to be. Boxes speak where no base part was found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.datatypes import Assembly, Detection, Frame, PoseEstimate
from asdfviz.detector.crop_classes import group_box, group_name, group_radius
from asdfviz.errors import WeightsError
from asdfviz.geometry.boxes import is_in_view
from asdfviz.geometry.shapes import Scores
from asdfviz.methods.first_pose import CropPoseConfig, CropPoses, LooksAtParts, load_looker
from asdfviz.methods.network import NetworkConfig, has_own_detector
from asdfviz.state.appearance import AppearanceConfig, appearance_probabilities

StateLooksFrom: TypeAlias = Literal["boxes", "crops"]
"""What tells the state by its looks."""


@dataclass(frozen=True, slots=True, eq=False)
class GroupLooker:
    """Tells an assembly's state from a crop about the base part."""

    assembly: Assembly
    looker: LooksAtParts
    radius: float
    """`group_radius`."""
    order: Int64[np.ndarray, "states"]
    """Place of each of the assembly's states among those that the network tells of its group."""
    odds: Float64[np.ndarray, "states"]
    """How much likelier a state is than the network's training showed it."""

    @classmethod
    def of(
        cls, assembly: Assembly, looker: LooksAtParts, *, config: AppearanceConfig
    ) -> GroupLooker | None:
        """None where the network does not know each of the assembly's states, by name."""
        known = looker.states.get(group_name(assembly), ())
        if not {state.name for state in assembly.states} <= set(known):
            return None
        order = np.array([known.index(state.name) for state in assembly.states])
        odds = np.array([config.error_odds if s.is_error else 1.0 for s in assembly.states])
        return cls(assembly, looker, group_radius(assembly), order, odds)

    def look(self, poses: Mapping[str, PoseEstimate], frame: Frame) -> Scores | None:
        """Probability of every state; None where the base part has no pose or lies out of view."""
        base, camera = poses.get(self.assembly.base), frame.camera
        if base is None:
            return None
        box = group_box(self.assembly, self.radius, base.T_camera_part, camera.K)
        if not is_in_view(box, (camera.width, camera.height)):
            return None
        name = group_name(self.assembly)
        told = self.looker.look(frame.rgb, camera.K, {name: (name, box)})[name].states
        weighted = told[self.order] * self.odds
        return weighted / weighted.sum()


@dataclass(frozen=True, slots=True, eq=False)
class StateLooks:
    """The term S_DL of an assembly."""

    assembly: Assembly
    config: AppearanceConfig
    group: GroupLooker | None
    """None: boxes alone."""

    @classmethod
    def of(
        cls,
        assembly: Assembly,
        *,
        config: AppearanceConfig,
        chosen: StateLooksFrom | None,
        detector: NetworkConfig,
        crops: CropPoseConfig,
        crop_poses: CropPoses | None,
    ) -> StateLooks:
        """What a method's options ask for.

        Args:
            assembly: whose states.
            config: of the boxes.
            chosen: None takes crops where first poses come from crops and their network knows the
                assembly's states, unless the detector is the assembly's own. A detector of several
                assemblies, trained as long, has hardly learnt their states.
            detector: says whose its weights are.
            crops: where the crop network is, if it is not loaded yet.
            crop_poses: holds the crop network, if it is.

        Raises:
            WeightsError: crops are chosen, and there is no network that knows the states.
        """
        if chosen is None and (crop_poses is None or has_own_detector(detector, assembly)):
            chosen = "boxes"
        if chosen == "boxes":
            return cls(assembly, config, None)
        looker = load_looker(crops, assembly) if crop_poses is None else crop_poses.looker
        group = GroupLooker.of(assembly, looker, config=config)
        if group is None and chosen == "crops":
            told = looker.states.get(group_name(assembly), ())
            raise WeightsError(
                f"the crop network does not know all states of '{assembly.name}': it has "
                f"{', '.join(told) or 'none'}; the assembly has "
                f"{', '.join(state.name for state in assembly.states)}. Train it with "
                "`asdfviz train-crops`, or choose --state-looks boxes"
            )
        return cls(assembly, config, group)

    def probabilities(
        self,
        detections: Sequence[Detection],
        poses: Mapping[str, PoseEstimate],
        frame: Frame,
    ) -> Scores | None:
        """Probability of every state by its looks, or None where nothing speaks."""
        told = None if self.group is None else self.group.look(poses, frame)
        if told is not None:
            return told
        return appearance_probabilities(detections, self.assembly, config=self.config)
