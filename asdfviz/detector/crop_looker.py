"""The crop network ready to run: from boxes of a frame to rotations, outlines and places of parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float64, UInt8
from torch import Tensor

from asdfviz.detector.blocks import Conv
from asdfviz.detector.crop_answer import REACH, CropAnswer
from asdfviz.detector.crop_cut import crop_camera, cut, metric_side
from asdfviz.detector.crop_weights import load_crop_network
from asdfviz.detector.precision import has_bfloat16
from asdfviz.geometry.rotation_grid import even_rotations
from asdfviz.geometry.rotation_modes import modes
from asdfviz.geometry.shapes import Box, Intrinsics, Rgb

_Answer = TypeVar("_Answer")


@dataclass(frozen=True, slots=True)
class CropLookerConfig:
    """How a crop network runs."""

    count: int = 20
    """Rotations that are handed on."""
    device: str = "cpu"
    bfloat16: bool = False
    """Faster where the device has it."""


class CropLooker:
    """A crop network with its weights."""

    def __init__(self, weights: Path, *, config: CropLookerConfig | None = None) -> None:
        """Load the weights.

        Raises:
            WeightsError: the file is missing, corrupt or of another network.
        """
        self._config = config or CropLookerConfig()
        loaded = load_crop_network(weights)
        self.classes, self.states = loaded.classes, loaded.states
        self.tells_names = loaded.network.tells_names
        self._number = {name: place for place, name in enumerate(loaded.classes)}
        for module in loaded.network.modules():
            if isinstance(module, Conv):
                module.fuse()
        self._network = loaded.network.to(self._config.device)
        self._network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
        self._grid = even_rotations(loaded.network.grid)
        self._span = loaded.spans

    @torch.inference_mode()
    def names(
        self,
        rgb: Rgb,
        K: Intrinsics,
        boxes: Sequence[Box],
        classes: Sequence[str],
        *,
        distances: Sequence[float | None],
    ) -> Float64[np.ndarray, "n c"]:
        """Which part is in each box, if any.

        Args:
            rgb: the frame.
            K: its intrinsics.
            boxes: pixels.
            classes: that come into question; one that the network does not know has probability 0.
            distances: along z from the camera to what is in each box, metres; None where unknown.

        Returns:
            Of each box the probability of every class; what is missing to 1 is that none is there.
            Zeros where the network was not taught names.
        """
        wanted = [self._number.get(name, -1) for name in classes]
        known = [i for i in wanted if i >= 0]
        found = np.zeros((len(boxes), len(classes)))
        if not self.tells_names or not known or not len(boxes):
            return found
        cameras = [crop_camera(box, K) for box in boxes]
        pictures = np.stack([cut(rgb, camera, K) for camera in cameras])
        sizes = torch.tensor(
            [
                np.nan if z is None else metric_side(camera, z)
                for camera, z in zip(cameras, distances, strict=True)
            ],
            dtype=torch.float32,
            device=self._config.device,
        )
        logits = self._run(pictures, lambda crops: self._network.names(crops, sizes))
        logits = logits[:, [*known, len(self.classes)]].float()
        found[:, [i >= 0 for i in wanted]] = logits.softmax(1)[:, :-1].cpu().numpy()
        return found

    def _run(
        self, pictures: UInt8[np.ndarray, "n s s 3"], network: Callable[[Tensor], _Answer]
    ) -> _Answer:
        """Show crops to a network."""
        device = self._config.device
        crops = torch.as_tensor(pictures).to(device).permute(0, 3, 1, 2).float() / 255 - 0.5
        crops = crops.contiguous(memory_format=torch.channels_last)
        half = self._config.bfloat16 and has_bfloat16(device)
        with torch.autocast(torch.device(device).type, torch.bfloat16, enabled=half):
            return network(crops)

    @torch.inference_mode()
    def look(
        self, rgb: Rgb, K: Intrinsics, boxes: Mapping[str, tuple[str, Box]]
    ) -> dict[str, CropAnswer]:
        """Look at parts.

        Args:
            rgb: the frame.
            K: its intrinsics.
            boxes: for each part its class in the network and its box; classes that the network
                does not know get no answer.
        """
        known = {name: value for name, value in boxes.items() if value[0] in self._number}
        if not known:
            return {}
        cameras = {name: crop_camera(box, K) for name, (_, box) in known.items()}
        pictures = np.stack([cut(rgb, camera, K) for camera in cameras.values()])
        labels = [self._number[label] for label, _ in known.values()]
        numbers = torch.tensor(labels, device=self._config.device)
        out = self._run(pictures, lambda crops: self._network(crops, numbers))
        probabilities = out.rotations.float().softmax(1).double().cpu().numpy()
        places = out.place.float().double().cpu().numpy()
        outlines = out.outline.float().sigmoid().double().cpu().numpy()
        logits = out.states.double()
        answers: dict[str, CropAnswer] = {}
        for i, (name, camera) in enumerate(cameras.items()):
            rotations, weights = modes(
                probabilities[i], self._grid, count=self._config.count, reach=REACH
            )
            span = self._span.get(known[name][0], slice(0))
            states = logits[i, span].softmax(0).cpu().numpy()
            answers[name] = CropAnswer(
                camera=camera,
                rotations=rotations,
                probabilities=weights,
                grid=self._grid,
                distribution=probabilities[i],
                place=places[i],
                outline=outlines[i],
                states=states,
            )
        return answers
