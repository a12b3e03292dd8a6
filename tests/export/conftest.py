"""A sequence in memory: two parts over a table, with truth, an error state and visibility."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Camera, Frame, FrameTruth, Mesh, Part, State
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from

CAMERA = Camera(np.array([[70.0, 0, 31.5], [0, 71.0, 23.25], [0, 0, 1]]), 64, 48)


def make_part(name: str, symmetries: Symmetries) -> Part:
    vertices = np.array([[0, 0, 0], [0.03, 0, 0], [0, 0.04, 0], [0, 0, 0.05]], dtype=np.float64)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)
    return Part(
        name=name,
        mesh=Mesh(vertices, faces),
        keypoints=np.resize(vertices, (17, 3)),
        symmetries=symmetries,
        diameter=float(np.hypot(0.04, 0.05)),
        color=np.array([1, 2, 3], dtype=np.uint8),
        detector_class=name,
    )


@pytest.fixture(scope="session")
def assembly() -> Assembly:
    turn = transform_from(rotation_about(np.array([0.0, 0, 1]), np.pi), np.array([0.01, 0, 0]))
    axis = Axis(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 0.002]))
    parts = {
        "base <1>": make_part("base <1>", Symmetries()),
        "jaw": make_part("jaw", Symmetries(discrete=(turn,), continuous=(axis,))),
    }
    states = (
        State(0, "bare", {"base <1>": np.eye(4)}),
        State(1, "jaw on", {"base <1>": np.eye(4), "jaw": np.eye(4)}),
        State(2, "jaw lost", {"base <1>": np.eye(4)}, is_error=True, after=1),
    )
    return Assembly(
        name="two",
        title="Two",
        base="base <1>",
        parts=parts,
        states=states,
        transitions=frozenset({(0, 1)}),
        detector_classes=("base <1>", "jaw"),
        path="/nowhere/assembly.yaml",
    )


@dataclass(frozen=True)
class MemorySequence:
    assembly: Assembly | None
    name: str = "memory"
    path: str = "/memory"
    camera: Camera = CAMERA
    frame_indices: tuple[int, ...] = (0, 1, 5)

    def __len__(self) -> int:
        return len(self.frame_indices)

    def __getitem__(self, place: int) -> Frame:
        index = self.frame_indices[place]
        rng = np.random.default_rng(index)
        rgb = rng.integers(0, 256, (48, 64, 3), dtype=np.uint8)
        depth = rng.integers(0, 9000, (48, 64)).astype(np.float32) * np.float32(1e-4)
        return Frame(index, index / 30, rgb, depth if index != 1 else None, CAMERA)

    def truth(self, place: int) -> FrameTruth | None:
        return None


@pytest.fixture
def memory(assembly: Assembly) -> MemorySequence:
    return MemorySequence(assembly)


@pytest.fixture
def truth() -> dict[int, FrameTruth]:
    rng = np.random.default_rng(3)

    def pose() -> np.ndarray:
        R = rotation_about(rng.normal(size=3), rng.uniform(0, 3))
        return transform_from(R, rng.normal(size=3) / 3)

    return {
        0: FrameTruth(0, {"base <1>": pose()}, 0, False, ("base <1>",), {"base <1>": 1 / 3}),
        5: FrameTruth(
            5,
            {"jaw": pose(), "base <1>": pose()},
            1,
            True,
            ("base <1>",),
            {"base <1>": 0.5, "jaw": 0.0},
        ),
    }
