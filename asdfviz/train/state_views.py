"""From stored crops of groups to what the state network is shown: cut about a base pose as methods find it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Int64
from torch import Tensor

from asdfviz.datatypes import Assembly, Part
from asdfviz.detector.crop_classes import CropClass, group_states, state_spans
from asdfviz.detector.state_cut import (
    STATE_SIZE,
    BasePoses,
    long_axis,
    seen_by,
    state_cameras,
)
from asdfviz.geometry.rotation_grid import rotations_of
from asdfviz.geometry.sampling import farthest_points, oriented_surface_points, surface_middle
from asdfviz.geometry.transforms import apply
from asdfviz.synth.joint_motion import joined_poses
from asdfviz.synth.tensors import to_tensor
from asdfviz.train.crop_data import Crops
from asdfviz.train.crop_views import cut_views, toned

STORED_STATE_PIXELS = 288
"""Side of a stored crop."""
POINTS = 160
"""Of a group, on all of its parts alike."""
_DRAWS, _SAMPLES = 4, 160
TURNED, FAR_TURNED, FAR = 0.05, 0.25, 0.12
"""Radians by which a base pose is off about each axis, usually and in a share of the crops,"""
FLIPPED = 0.04
"""how often it is end for end,"""
ACROSS, ALONG = 0.004, 0.015
"""and how far its middle is beside the truth, as shares of its distance: across the ray and along it."""
ROLL = 0.04
"""Radians."""


@dataclass(frozen=True, slots=True, eq=False)
class StateViews:
    """A training batch."""

    pictures: Float32[Tensor, "b 3 h w"]
    """RGB, -0.5 to 0.5."""
    groups: Int64[Tensor, "b"]
    poses: BasePoses
    """As a method would find them, in the crops' cameras."""
    focal: Float32[Tensor, "b"]
    """Of these."""
    states: Int64[Tensor, "b"]
    """The place among the states of all groups."""


class StateViewMaker:
    """Cuts views of stored crops of groups; has the points, normals and axes of these."""

    def __init__(
        self, assemblies: Sequence[Assembly], classes: Sequence[CropClass], *, device: str = "cpu"
    ) -> None:
        self.device = device
        labels = [place for place, c in enumerate(classes) if c.states]
        self._group = torch.full((len(classes),), -1, dtype=torch.int64, device=device)
        self._group[labels] = torch.arange(len(labels), device=device)
        bases = [assembly.parts[assembly.base] for assembly in assemblies]
        middles = [surface_middle(base.mesh.vertices, base.mesh.faces) for base in bases]
        self._middle = self._tensor(np.stack(middles))
        sampled = [group_points(assembly) for assembly in assemblies]
        self.points = self._tensor(np.stack([points for points, _ in sampled]))
        self.normals = self._tensor(np.stack([normals for _, normals in sampled]))
        self.axes = self._tensor(np.stack([long_axis(points) for points, _ in sampled]))
        spans = state_spans(group_states(classes))
        own = torch.zeros(len(labels), sum(len(c.states) for c in classes), dtype=torch.bool)
        for row, label in enumerate(labels):
            own[row, spans[classes[label].name]] = True
        self._own = own.to(device)

    def views(self, crops: Crops, *, rng: np.random.Generator, jitter: float = 1.0) -> StateViews:
        """Show crops of groups.

        Args:
            crops: on this device.
            rng: errors of poses, tones.
            jitter: factor on the errors; with 0 tones stay, too.
        """
        groups = self._group[crops.labels]
        poses = self._believed(crops, groups, rng, jitter)
        roll = jitter * ROLL * self._normal(rng, len(crops), 1)[:, 0]
        cameras = state_cameras(self.points[groups], self.axes[groups], poses, roll=roll)
        rgb = cut_views(crops, cameras.R_camera_crop, cameras.focal, size=STATE_SIZE)[:, :3]
        if jitter > 0:
            rgb = toned(rgb, rng)
        return StateViews(rgb - 0.5, groups, seen_by(cameras, poses), cameras.focal, crops.states)

    def _believed(
        self, crops: Crops, groups: Tensor, rng: np.random.Generator, jitter: float
    ) -> BasePoses:
        """Base poses as methods would find them, in the stored crops' cameras."""
        T, middle_base = crops.T_crop_part, self._middle[groups][:, :, None]
        R = T[:, :3, :3] @ self._errors(len(crops), rng, jitter)
        middle = (T[:, :3, :3] @ middle_base + T[:, :3, 3:])[:, :, 0]
        off = self._normal(rng, len(crops), 3) * jitter
        off[:, :2] *= ACROSS
        off[:, 2] *= ALONG
        middle = middle + off * middle[:, 2:]
        return BasePoses(R, middle - (R @ middle_base)[:, :, 0])

    def own_states(
        self, logits: Float32[Tensor, "b t"], groups: Int64[Tensor, "b"]
    ) -> Float32[Tensor, "b t"]:
        """Logits of states, minus infinity for those of other groups."""
        return logits.masked_fill(~self._own[groups], -torch.inf)

    def _errors(self, count: int, rng: np.random.Generator, jitter: float) -> Tensor:
        """R_base_believed: true rotations to those that are believed."""
        size = np.where(rng.random(count) < FAR, FAR_TURNED, TURNED)[:, None]
        turned = rng.normal(size=(count, 3)) * size * jitter
        flipped = (rng.random(count) < FLIPPED) & (jitter > 0)
        turned[flipped] = np.pi * np.eye(3)[rng.integers(3, size=flipped.sum())]
        angle = np.linalg.norm(turned, axis=1, keepdims=True)
        axis = turned / np.maximum(angle, 1e-9)
        return self._tensor(
            rotations_of(np.concatenate([axis * np.sin(angle / 2), np.cos(angle / 2)], axis=1))
        )

    def _normal(self, rng: np.random.Generator, *size: int) -> Tensor:
        return self._tensor(rng.normal(size=size).clip(-2.5, 2.5))

    def _tensor(self, values: np.ndarray) -> Tensor:
        return to_tensor(values.astype(np.float32), self.device)


def group_points(
    assembly: Assembly, *, count: int = POINTS
) -> tuple[Float32[np.ndarray, "p 3"], Float32[np.ndarray, "p 3"]]:
    """Points spread over the parts of a group in all their places, and their normals; base frame, metres."""
    rng = np.random.default_rng(0)
    shares = np.diff(np.linspace(0, count, len(assembly.parts) + 1).round().astype(int))
    found: list[np.ndarray] = []
    for part, share in zip(assembly.parts.values(), shares, strict=True):
        if share:
            found.append(_spread(part, _placed(assembly, part, rng), int(share)))
    both = np.concatenate(found).astype(np.float32)
    return both[:, :3], both[:, 3:]


def _placed(assembly: Assembly, part: Part, rng: np.random.Generator) -> list[np.ndarray]:
    """T_base_part of a part in every state, and within the freedom of its joints there."""
    places: dict[bytes, np.ndarray] = {}
    for state in assembly.states:
        if part.name not in state.T_base_part:
            continue
        nominal = state.T_base_part[part.name]
        draws = _DRAWS if part.name in state.joints else 0
        for T in (nominal, *(joined_poses(state, rng)[part.name] for _ in range(draws))):
            places[np.round(T, 6).tobytes()] = T
    return list(places.values()) or [np.eye(4)]


def _spread(part: Part, places: Sequence[np.ndarray], count: int) -> np.ndarray:
    mesh = part.mesh
    points, normals = oriented_surface_points(mesh.vertices, mesh.faces, _SAMPLES)
    placed = np.concatenate([apply(T, points) for T in places])
    turned = np.concatenate([normals @ T[:3, :3].T for T in places])
    chosen = farthest_points(placed, count)
    rows = np.linalg.norm(placed[None] - chosen[:, None], axis=2).argmin(axis=1)
    return np.concatenate([placed[rows], turned[rows]], axis=1)
