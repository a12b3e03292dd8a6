"""The network's term of the state, S_DL: from state boxes as in the paper, or from a crop about the base.

The crops are ours: a state box must be found and told from all others in the whole picture, while the
crop network looks where the base part is known to be, and the state network where its pose puts each
joined part. Boxes speak where no base part was found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, TypeAlias, runtime_checkable

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.datatypes import Assembly, Detection, Frame, PoseEstimate
from asdfviz.detector.crop_classes import group_box, group_name, group_radius
from asdfviz.errors import WeightsError
from asdfviz.geometry.boxes import is_in_view
from asdfviz.geometry.shapes import Intrinsics, Rgb, Scores, Transform
from asdfviz.methods.first_pose import (
    CropPoseConfig,
    CropPoses,
    FirstPose,
    LooksAtParts,
    load_looker,
)
from asdfviz.methods.network import NetworkConfig, has_own_detector, shipped_weights
from asdfviz.state.appearance import AppearanceConfig, appearance_probabilities

StateLooksFrom: TypeAlias = Literal["boxes", "crops", "places"]
"""What tells the state by its looks."""
STATE_WEIGHTS = "states.safetensors"
"""File beside assembly.yaml, or one folder up, that methods use unless told otherwise."""


@runtime_checkable
class LooksAtGroups(Protocol):
    """Anything that tells states from a frame in which the base part's pose is known."""

    @property
    def states(self) -> Mapping[str, tuple[str, ...]]:
        """Of every group that it knows, the states that it tells apart."""
        ...

    def look(
        self, rgb: Rgb, K: Intrinsics, assembly: Assembly, T_camera_base: Transform
    ) -> Scores | None:
        """Probability of every state of the assembly's group, in that order; None: nothing is seen."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class CropStates:
    """The crop network as one of these."""

    looker: LooksAtParts
    radius: float
    """`group_radius` of the assembly."""

    @property
    def states(self) -> Mapping[str, tuple[str, ...]]:
        """The crop network's."""
        return self.looker.states

    def look(
        self, rgb: Rgb, K: Intrinsics, assembly: Assembly, T_camera_base: Transform
    ) -> Scores | None:
        """What the crop network says of the group's box."""
        name = group_name(assembly)
        box = group_box(assembly, self.radius, T_camera_base, K)
        return self.looker.look(rgb, K, {name: (name, box)})[name].states


@dataclass(frozen=True, slots=True, eq=False)
class GroupLooker:
    """Tells an assembly's state from what is seen about the base part."""

    assembly: Assembly
    looker: LooksAtGroups
    radius: float
    """`group_radius`."""
    order: Int64[np.ndarray, "states"]
    """Place of each of the assembly's states among those that the network tells of its group."""
    odds: Float64[np.ndarray, "states"]
    """How much likelier a state is than the network's training showed it."""

    @classmethod
    def of(
        cls, assembly: Assembly, looker: LooksAtGroups, *, config: AppearanceConfig
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
        told = self.looker.look(frame.rgb, camera.K, self.assembly, base.T_camera_part)
        if told is None:
            return None
        weighted = told[self.order] * self.odds
        return weighted / weighted.sum()


def state_weights_path(crops: CropPoseConfig, assembly: Assembly) -> Path:
    """The file that the state network is read from; it need not exist."""
    if crops.state_weights is not None:
        return crops.state_weights.expanduser().resolve()
    return shipped_weights(assembly, STATE_WEIGHTS)


def asked_state_network(
    chosen: StateLooksFrom | None,
    first_pose: FirstPose,
    crops: CropPoseConfig,
    assembly: Assembly,
) -> Path | None:
    """The file of the state network that methods with these options ask; None: they ask none.

    Args:
        chosen: what tells the state by its looks; None takes a state network where first poses come
            from crops and there is one that knows the assembly's states.
        first_pose: what first poses come from.
        crops: where the weights are.
        assembly: whose states.

    Raises:
        WeightsError: the network is corrupt.
    """
    is_default = chosen is None and first_pose == "hypotheses"
    if chosen == "places" or (is_default and has_state_network(crops, assembly)):
        return state_weights_path(crops, assembly)
    return None


def load_state_looker(crops: CropPoseConfig, assembly: Assembly) -> LooksAtGroups:
    """Load the state network for an assembly.

    Raises:
        InputError: the device is not there.
        WeightsError: there are no weights, or no whole ones.
    """
    from asdfviz.detector.device import require_device
    from asdfviz.detector.state_looker import StateLooker, StateLookerConfig

    require_device(crops.device)
    config = StateLookerConfig(crops.device, crops.bfloat16)
    return StateLooker(state_weights_path(crops, assembly), config=config)


def has_state_network(crops: CropPoseConfig, assembly: Assembly) -> bool:
    """Whether there is a state network that knows each of an assembly's states.

    Raises:
        WeightsError: there is a corrupt one.
    """
    path = state_weights_path(crops, assembly)
    if not path.is_file():
        return False
    from asdfviz.detector.state_weights import states_known

    known = states_known(path).get(group_name(assembly), ())
    return {state.name for state in assembly.states} <= set(known)


def _unknown(
    assembly: Assembly, states: Mapping[str, Sequence[str]], chosen: StateLooksFrom
) -> WeightsError:
    told = states.get(group_name(assembly), ())
    network, command = {"crops": ("crop", "crops"), "places": ("state", "states")}[chosen]
    return WeightsError(
        f"the {network} network does not know all states of '{assembly.name}': it has "
        f"{', '.join(told) or 'none'}; the assembly has "
        f"{', '.join(state.name for state in assembly.states)}. Train it with "
        f"`asdfviz train-{command}`, or choose --state-looks boxes"
    )


@dataclass(frozen=True, slots=True, eq=False)
class StateLooks:
    """The term S_DL of an assembly."""

    assembly: Assembly
    config: AppearanceConfig
    group: GroupLooker | None
    """None: boxes alone."""
    by_places: bool = False
    """Whether the state network tells them."""

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
            chosen: None takes, where first poses come from crops, the state network if there is one
                that knows the assembly's states; else the crop network if it does, unless the
                detector is the assembly's own. A detector of several assemblies, trained as long, has
                hardly learnt their states.
            detector: says whose its weights are.
            crops: where the crop network is, if it is not loaded yet, and the state network.
            crop_poses: holds the crop network, if it is.

        Raises:
            InputError: the device is not there.
            WeightsError: the network that is chosen is not there, is corrupt or does not know the
                states.
        """
        if chosen == "boxes" or (chosen is None and crop_poses is None):
            return cls(assembly, config, None)
        first_pose = "keypoints" if crop_poses is None else "hypotheses"
        asked = asked_state_network(chosen, first_pose, crops, assembly)
        by_places = asked is not None
        if by_places:
            looker = load_state_looker(crops, assembly)
        elif chosen is None and has_own_detector(detector, assembly):
            return cls(assembly, config, None)
        else:
            looks = load_looker(crops, assembly) if crop_poses is None else crop_poses.looker
            looker = CropStates(looks, group_radius(assembly))
        group = GroupLooker.of(assembly, looker, config=config)
        if group is None and chosen is not None:
            raise _unknown(assembly, looker.states, chosen)
        return cls(assembly, config, group, by_places)

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


class KeptLooks:
    """A state's looks in one sequence, asked in some of its frames."""

    def __init__(self, looks: StateLooks, *, every: int) -> None:
        """Begin a sequence; in one of `every` frames the network is asked."""
        self._looks, self._every = looks, every
        self._frames = 0
        self._told: Scores | None = None

    def step(
        self,
        detections: Sequence[Detection],
        poses: Mapping[str, PoseEstimate],
        frame: Frame,
    ) -> Scores | None:
        """As `StateLooks.probabilities`, or as it said last."""
        is_due = self._frames % self._every == 0
        self._frames += 1
        group = self._looks.group
        if is_due or group is None or self._told is None or group.assembly.base not in poses:
            self._told = self._looks.probabilities(detections, poses, frame)
        return self._told
