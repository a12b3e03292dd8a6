"""A toy scene: a base, a block and two like pins, all boxes, with a detector that knows the truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Camera, Detection, Frame, Mesh, Part, State
from asdfviz.geometry.camera import project
from asdfviz.geometry.sampling import diameter, farthest_points, surface_points
from asdfviz.geometry.shapes import Box, Depth, Intrinsics, Points, Rgb, Transform
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import apply, inverse, rotation_about, transform_from
from asdfviz.methods import tracking
from asdfviz.track.viewpoint_model import ViewpointConfig, ViewpointModel, build_viewpoint_model

CAMERA = Camera(np.array([[300.0, 0, 159.5], [0, 300.0, 119.5], [0, 0, 1]]), 320, 240)
HALF = {
    "base": np.array([0.06, 0.04, 0.01]),
    "block": np.array([0.02, 0.03, 0.02]),
    "pin": np.array([0.01, 0.01, 0.03]),
    "pin-copy": np.array([0.01, 0.01, 0.03]),
}
UNIT = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
FACES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ],
    dtype=np.int32,
)  # fmt: skip
JOINED = {"base": np.eye(4), "block": transform_from(np.eye(3), np.array([0.03, 0, 0.03]))}


def part(name: str) -> Part:
    mesh = Mesh(UNIT * HALF[name], FACES)
    return Part(
        name=name,
        mesh=mesh,
        keypoints=farthest_points(surface_points(mesh.vertices, FACES, 400), 17),
        symmetries=Symmetries(),
        diameter=diameter(mesh.vertices),
        color=np.full(3, 128, dtype=np.uint8),
        detector_class=name.removesuffix("-copy"),
    )


@pytest.fixture
def assembly() -> Assembly:
    """State 0 the base alone, state 1 with the block on it; the pins are never joined."""
    states = (
        State(0, "base", {"base": np.eye(4)}),
        State(1, "block", JOINED, detector_class="toy:block"),
    )
    classes = ("base", "block", "pin", "toy:block")
    parts = {name: part(name) for name in HALF}
    return Assembly(
        "toy", "Toy", "base", parts, states, frozenset({(0, 1)}), classes, "/toy/assembly.yaml"
    )


@dataclass
class FakeDetector:
    """Answers with what a frame's number stands for; the number is written into the picture."""

    answers: dict[int, tuple[Detection, ...]] = field(default_factory=dict)

    def detect(self, rgb: Rgb) -> tuple[Detection, ...]:
        return self.answers.get(int(rgb[0, 0, 0]), ())


@cache
def small_model(name: str, key: tuple[bytes, bytes]) -> ViewpointModel:
    vertices = np.frombuffer(key[0]).reshape(-1, 3)
    faces = np.frombuffer(key[1], np.int32).reshape(-1, 3)
    config = ViewpointConfig(subdivisions=2, points=200, image_size=300)
    return build_viewpoint_model(Mesh(vertices, faces), config=config)


@pytest.fixture
def small_models(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse viewpoint models, made once."""

    def load(assembly: Assembly, **_: object) -> dict[str, ViewpointModel]:
        return {
            name: small_model(name, (part.mesh.vertices.tobytes(), part.mesh.faces.tobytes()))
            for name, part in assembly.parts.items()
        }

    monkeypatch.setattr(tracking, "load_viewpoint_models", load)


@dataclass
class Namer:
    """Names what is in boxes as a function of class and box says, and notes what it was asked."""

    says: Callable[[str, Box], float]
    boxes: list[Box] = field(default_factory=list)
    distances: list[float | None] = field(default_factory=list)
    asked: list[int] = field(default_factory=list)
    """Number of boxes, time by time."""
    asked_of: set[tuple[str, ...]] = field(default_factory=set)
    """Classes, time by time."""
    classes: tuple[str, ...] = ("toy/base", "toy/block", "toy/pin")
    tells_names: bool = True

    def names(
        self,
        rgb: Rgb,
        K: Intrinsics,
        boxes: Sequence[Box],
        classes: Sequence[str],
        *,
        distances: Sequence[float | None],
    ) -> np.ndarray:
        self.asked_of.add(tuple(classes))
        self.boxes += boxes
        self.distances += distances
        self.asked.append(len(boxes))
        return np.array([[self.says(name, box) for name in classes] for box in boxes])


def around(corners: Points) -> tuple[slice, slice]:
    """Rows and columns of the picture that may show what lies between corners (camera frame)."""
    if corners[:, 2].min() <= 0:
        return slice(None), slice(None)
    pixels = project(corners, CAMERA.K)
    x0, y0 = np.maximum(np.floor(pixels.min(axis=0)).astype(int), 0)
    x1, y1 = np.maximum(np.ceil(pixels.max(axis=0)).astype(int) + 1, 0)
    return slice(y0, y1), slice(x0, x1)


@dataclass(frozen=True, eq=False)
class Toy:
    """Makes frames and detections from true poses."""

    assembly: Assembly

    def poses(self, *, joined: bool) -> dict[str, Transform]:
        T_camera_base = transform_from(
            rotation_about(np.array([1.0, 0.2, 0.1]), 2.4), np.array([0.03, 0.02, 0.55])
        )
        apart = transform_from(
            rotation_about(np.array([0.3, 1.0, 0]), 0.6), np.array([-0.12, -0.06, 0.5])
        )
        return {
            "base": T_camera_base,
            "block": T_camera_base @ JOINED["block"] if joined else apart,
        }

    def depth(self, Ts_camera_part: Mapping[str, Transform]) -> Depth:
        v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
        K = CAMERA.K
        rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(u.shape)], -1)
        depth = np.full(u.shape, 0.75)
        for name, T_camera_part in Ts_camera_part.items():
            seen = around(apply(T_camera_part, UNIT * HALF[name]))
            T_part_camera = inverse(T_camera_part)
            directions = rays[seen] @ T_part_camera[:3, :3].T + 1e-12
            a = (-HALF[name] - T_part_camera[:3, 3]) / directions
            b = (HALF[name] - T_part_camera[:3, 3]) / directions
            near, far = np.minimum(a, b), np.maximum(a, b)
            # Axis by axis: numpy reduces an axis of three slowly.
            enter = np.maximum(np.maximum(near[..., 0], near[..., 1]), near[..., 2])
            leave = np.minimum(np.minimum(far[..., 0], far[..., 1]), far[..., 2])
            hit = (enter < leave) & (enter > 0)
            depth[seen] = np.where(hit, np.minimum(depth[seen], enter), depth[seen])
        return depth.astype(np.float32)

    def frame(self, index: int, Ts_camera_part: Mapping[str, Transform] | None = None) -> Frame:
        rgb = np.full((CAMERA.height, CAMERA.width, 3), index, dtype=np.uint8)
        depth = None if Ts_camera_part is None else self.depth(Ts_camera_part)
        return Frame(index, 0.1 * index, rgb, depth, CAMERA)

    def photo(self, index: int, blocks: Sequence[Transform]) -> Frame:
        """Orange blocks on a grey table, with a camera's noise."""
        depth = np.min([self.depth({"block": T}) for T in blocks], axis=0)
        rgb = np.where((depth < 0.7)[:, :, None], (220, 120, 20), (110, 115, 120))
        noise = np.random.default_rng(index).normal(size=rgb.shape) * 3
        plain = self.frame(index)
        return replace(plain, rgb=(rgb + noise).astype(np.uint8), depth=depth.astype(np.float32))

    def detection(
        self,
        name: str,
        T_camera_part: Transform,
        *,
        score: float = 0.8,
        shrink: float = 1.0,
        noise_px: float = 0.0,
        seed: int = 0,
    ) -> Detection:
        """The part's box with its keypoints, drawn towards the middle by `shrink`."""
        part = self.assembly.parts[name]
        corners = project(apply(T_camera_part, part.mesh.vertices), CAMERA.K)
        box = np.concatenate([corners.min(axis=0), corners.max(axis=0)])
        middle = (box[:2] + box[2:]) / 2
        pixels = middle + shrink * (
            project(apply(T_camera_part, part.keypoints), CAMERA.K) - middle
        )
        pixels = pixels + np.random.default_rng(seed).normal(size=pixels.shape) * noise_px
        return Detection(part.detector_class, box, pixels, np.ones(17), score)

    def state_box(self, score: float) -> Detection:
        box = np.array([100.0, 80, 220, 160])
        return Detection("toy:block", box, np.full((17, 2), 120.0), np.ones(17), score)


@pytest.fixture
def toy(assembly: Assembly) -> Toy:
    return Toy(assembly)


@pytest.fixture
def box_at() -> Callable[..., Detection]:
    """Make a 20 px box with its left upper corner at (x, y)."""

    def make(label: str, x: float, y: float = 0.0, score: float = 0.5) -> Detection:
        box = np.array([x, y, x + 20, y + 20], dtype=float)
        return Detection(label, box, np.zeros((17, 2)), np.ones(17), score)

    return make


@pytest.fixture
def detector() -> FakeDetector:
    return FakeDetector()


@pytest.fixture
def namer() -> Callable[[Callable[[str, Box], float]], Namer]:
    """Make a network that names things as it is told to."""
    return Namer
