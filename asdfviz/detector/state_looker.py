"""The state network ready to run: from a base part's pose in a frame to the probabilities of states."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from asdfviz.datatypes import Assembly
from asdfviz.detector.blocks import Conv
from asdfviz.detector.crop_classes import group_name
from asdfviz.detector.crop_cut import CropCamera, cut
from asdfviz.detector.precision import has_bfloat16
from asdfviz.detector.state_cut import (
    STATE_SIZE,
    BasePoses,
    StateCameras,
    are_ahead,
    seen_by,
    state_cameras,
)
from asdfviz.detector.state_weights import load_state_network
from asdfviz.geometry.shapes import Intrinsics, Rgb, Scores, Transform


@dataclass(frozen=True, slots=True)
class StateLookerConfig:
    """How a state network runs."""

    device: str = "cpu"
    bfloat16: bool = False
    """Faster where the device has it."""


class StateLooker:
    """A state network with its weights."""

    def __init__(self, weights: Path, *, config: StateLookerConfig | None = None) -> None:
        """Load the weights.

        Raises:
            WeightsError: the file is missing, corrupt or of another network.
        """
        self._config = config or StateLookerConfig()
        loaded = load_state_network(weights)
        self.states = loaded.states
        for module in loaded.network.modules():
            if isinstance(module, Conv):
                module.fuse()
        self._network = loaded.network.to(self._config.device)
        self._network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
        self._number = {name: place for place, name in enumerate(loaded.states)}
        self._span = loaded.spans

    @torch.inference_mode()
    def look(
        self, rgb: Rgb, K: Intrinsics, assembly: Assembly, T_camera_base: Transform
    ) -> Scores | None:
        """Probability of every state, in the network's order; None where the group reaches behind the camera.

        Args:
            rgb: the frame.
            K: its intrinsics.
            assembly: whose group; the network knows it.
            T_camera_base: where the base part is, metres.
        """
        device, span = self._config.device, self._span[group_name(assembly)]
        group = torch.tensor([self._number[group_name(assembly)]], device=device)
        T = torch.tensor(T_camera_base[None], dtype=torch.float32, device=device)
        poses, points = BasePoses(T[:, :3, :3], T[:, :3, 3]), self._network.points[group]
        if not are_ahead(points, poses):
            return None
        cameras = state_cameras(points, self._network.axes[group], poses)
        there = seen_by(cameras, poses)
        picture = torch.as_tensor(cut(rgb, _camera(cameras), K, size=STATE_SIZE)).to(device)
        crops = picture.permute(2, 0, 1)[None].float() / 255 - 0.5
        crops = crops.contiguous(memory_format=torch.channels_last)
        half = self._config.bfloat16 and has_bfloat16(device)
        with torch.autocast(torch.device(device).type, torch.bfloat16, enabled=half):
            logits = self._network(crops, group, there, cameras.focal)
        return logits[0, span].double().softmax(0).cpu().numpy()


def _camera(cameras: StateCameras) -> CropCamera:
    """The first of them, to cut with."""
    focal, (width, height) = float(cameras.focal[0]), STATE_SIZE
    K = [[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]]
    return CropCamera(np.array(K), cameras.R_camera_crop[0].double().cpu().numpy())
