"""The state network ready to run: from a base part's pose in a frame to the probabilities of states."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from asdfviz.datatypes import Assembly
from asdfviz.detector.blocks import Conv
from asdfviz.detector.crop_classes import group_name
from asdfviz.detector.crop_cut import cut
from asdfviz.detector.precision import has_bfloat16
from asdfviz.detector.state_cut import STATE_PIXELS, GroupFrame, state_camera
from asdfviz.detector.state_network import BasePoses
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
        self._frames: dict[str, GroupFrame] = {}

    @torch.inference_mode()
    def look(
        self, rgb: Rgb, K: Intrinsics, assembly: Assembly, T_camera_base: Transform
    ) -> Scores | None:
        """Probability of every state, in the network's order; None where the base part is behind the camera.

        Args:
            rgb: the frame.
            K: its intrinsics.
            assembly: whose group; the network knows it.
            T_camera_base: where the base part is, metres.
        """
        name, device = group_name(assembly), self._config.device
        if name not in self._frames:
            self._frames[name] = GroupFrame.of(assembly)
        camera = state_camera(self._frames[name], T_camera_base)
        if camera is None:
            return None
        picture = torch.as_tensor(cut(rgb, camera, K, side=STATE_PIXELS)).to(device)
        crops = (picture.permute(2, 0, 1)[None].float() / 255 - 0.5).contiguous(
            memory_format=torch.channels_last
        )
        R_crop_camera = camera.R_camera_crop.T

        def tensor(values: np.ndarray) -> torch.Tensor:
            return torch.as_tensor(values, dtype=torch.float32, device=device)[None]

        poses = BasePoses(
            tensor(R_crop_camera @ T_camera_base[:3, :3]),
            tensor(R_crop_camera @ T_camera_base[:3, 3]),
            tensor(np.array(camera.K[0, 0])),
        )
        group = torch.tensor([self._number[name]], device=device)
        half = self._config.bfloat16 and has_bfloat16(device)
        with torch.autocast(torch.device(device).type, torch.bfloat16, enabled=half):
            logits = self._network(crops, group, poses)
        return logits[0, self._span[name]].double().softmax(0).cpu().numpy()
