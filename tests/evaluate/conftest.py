"""A small analytic assembly (plate, rod, block) and builders of truth and runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
import pytest

from asdfviz.datatypes import (
    Assembly,
    Camera,
    FramePrediction,
    FrameTruth,
    Mesh,
    Part,
    PoseEstimate,
    Run,
    State,
    StateEstimate,
)
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from

BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 7, 5], [4, 6, 7], [0, 5, 1], [0, 4, 5]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ],
    dtype=np.int32,
)


def box(x: float, y: float, z: float) -> Mesh:
    corners = [(i, j, k) for k in (0, 1) for j in (0, 1) for i in (0, 1)]
    return Mesh((np.array(corners, float) - 0.5) * np.array([x, y, z]), BOX_FACES)


def rod(radius: float, length: float, *, sides: int = 48) -> Mesh:
    angles = np.arange(sides) * 2 * np.pi / sides
    ring = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    vertices = np.concatenate(
        [np.column_stack([ring, np.full(sides, z)]) for z in (-length / 2, length / 2)]
    )
    faces = [
        face
        for i, j in zip(range(sides), [*range(1, sides), 0], strict=True)
        for face in ([i, j, sides + i], [j, sides + j, sides + i])
    ]
    return Mesh(vertices, np.array(faces, dtype=np.int32))


def make_part(name: str, mesh: Mesh, symmetries: Symmetries) -> Part:
    return Part(
        name=name,
        mesh=mesh,
        keypoints=np.resize(mesh.vertices, (17, 3)),
        symmetries=symmetries,
        diameter=diameter(mesh.vertices),
        color=np.array([200, 200, 200], dtype=np.uint8),
        detector_class=name,
    )


@pytest.fixture(scope="session")
def assembly() -> Assembly:
    """plate: no symmetry, d about 92 mm; rod: turns about z; block: looks the same after 180 deg about z."""
    half_turn = transform_from(rotation_about(np.array([0.0, 0, 1]), np.pi), np.zeros(3))
    axis = Axis(np.array([0.0, 0, 1]), np.zeros(3))
    parts = {
        "plate": make_part("plate", box(0.08, 0.04, 0.02), Symmetries()),
        "rod": make_part("rod", rod(0.005, 0.05), Symmetries(continuous=(axis,))),
        "block": make_part("block", box(0.03, 0.02, 0.01), Symmetries(discrete=(half_turn,))),
    }
    joined = {name: np.eye(4) for name in parts}
    states = (
        State(0, "bare", {"plate": np.eye(4)}),
        State(1, "rod in", {"plate": np.eye(4), "rod": np.eye(4)}),
        State(2, "done", joined),
        State(3, "rod wrong", {"plate": np.eye(4), "rod": np.eye(4)}, is_error=True, after=1),
    )
    return Assembly(
        name="toy",
        title="Toy",
        base="plate",
        parts=parts,
        states=states,
        transitions=frozenset({(0, 1), (1, 2)}),
        detector_classes=tuple(parts),
        path="/nowhere/assembly.yaml",
    )


@pytest.fixture(scope="session")
def camera() -> Camera:
    K = np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]])
    return Camera(K, 320, 240)


MakeTruth = Callable[..., FrameTruth]
MakePrediction = Callable[..., FramePrediction]
MakeRun = Callable[..., Run]


@pytest.fixture(scope="session")
def make_truth() -> MakeTruth:
    def make(
        index: int,
        poses: Mapping[str, np.ndarray],
        *,
        state: int | None = None,
        is_error: bool | None = None,
        visible: Mapping[str, float] | float | None = 1.0,
    ) -> FrameTruth:
        shares: Mapping[str, float] = {}
        if isinstance(visible, Mapping):
            shares = visible
        elif visible is not None:
            shares = dict.fromkeys(poses, visible)
        return FrameTruth(index, dict(poses), state, is_error, visible=shares)

    return make


@pytest.fixture(scope="session")
def make_prediction() -> MakePrediction:
    def make(
        index: int,
        poses: Mapping[str, np.ndarray],
        *,
        state: int | None = None,
        runtime: Mapping[str, float] | None = None,
    ) -> FramePrediction:
        estimates = {name: PoseEstimate(name, T, 0.9, "pnp") for name, T in poses.items()}
        said = None if state is None else StateEstimate(np.eye(4)[state])
        return FramePrediction(index, estimates, said, runtime=dict(runtime or {}))

    return make


@pytest.fixture(scope="session")
def make_run() -> MakeRun:
    def make(predictions: Sequence[FramePrediction], **fields: object) -> Run:
        values: dict[str, object] = {
            "method": "fake",
            "config": {},
            "sequence": "/data/toy_scene",
            "assembly": "/nowhere/assembly.yaml",
            "version": "0",
            "predictions": tuple(predictions),
        }
        return Run(**{**values, **fields})  # pyright: ignore[reportArgumentType]

    return make
