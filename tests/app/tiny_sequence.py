"""A small sequence in memory with the bundled assembly, and a run on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asdfviz.datatypes import (
    Assembly,
    Camera,
    Frame,
    FramePrediction,
    FrameTruth,
    PoseEstimate,
    Run,
    StateEstimate,
)
from asdfviz.geometry.transforms import transform_from

K = np.array([[500.0, 0.0, 319.5], [0.0, 500.0, 239.5], [0.0, 0.0, 1.0]])
COUNT = 8
FIRST = 100
"""Number of the first frame: numbers and places differ."""


class TinySequence:
    """Eight grey frames; part i lies at x = 0.05 i, half a metre away; the bolt leaves in frame 5."""

    def __init__(self, assembly: Assembly, folder: Path, *, with_truth: bool = True) -> None:
        self.assembly = assembly
        self.name = "tiny"
        self.path = str(folder)
        self.camera = Camera(K, 640, 480)
        self.frame_indices = tuple(range(FIRST, FIRST + COUNT))
        self.fps = 10.0
        self._with_truth = with_truth

    def __len__(self) -> int:
        return COUNT

    def __getitem__(self, place: int) -> Frame:
        rgb = np.full((480, 640, 3), 20 * place, np.uint8)
        depth = np.full((480, 640), 0.6, np.float32)
        return Frame(self.frame_indices[place], place / 10, rgb, depth, self.camera)

    def truth(self, place: int) -> FrameTruth | None:
        if not self._with_truth:
            return None
        poses = {name: pose_of(i) for i, name in enumerate(self.assembly.parts)}
        if place >= 5:
            del poses["bolt"]
        return FrameTruth(self.frame_indices[place], poses, state=min(place // 3, 2))


def pose_of(number: int, *, shift: float = 0.0) -> np.ndarray:
    return transform_from(np.diag([1.0, -1.0, -1.0]), np.array([0.05 * number + shift, 0.0, 0.5]))


def make_run(assembly: Assembly, *, method: str = "asdf", shift: float = 0.002) -> Run:
    """Every part `shift` metres to the right of the truth; no state in frame 4, no jaw in frame 0."""
    predictions: list[FramePrediction] = []
    for place in range(COUNT):
        poses = {
            name: PoseEstimate(name, pose_of(i, shift=shift), 0.9, "refined")
            for i, name in enumerate(assembly.parts)
            if (place, name) != (0, "jaw")
        }
        probabilities = np.full(len(assembly.states), 0.1)
        probabilities[min(place // 3, 2)] = 1.0
        state = None if place == 4 else StateEstimate(probabilities / probabilities.sum())
        predictions.append(
            FramePrediction(FIRST + place, poses, state, runtime={"total": 0.02 + place / 1000})
        )
    return Run(method, {}, "tiny", assembly.path, "0", tuple(predictions))
