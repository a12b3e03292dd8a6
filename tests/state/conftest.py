"""A small assembly: a base, a block that slides, a round pin, and a lid; one error state."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Joint, Mesh, Part, PoseEstimate, State
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
SPIN = Symmetries(continuous=(Axis(np.array([0.0, 0.0, 1.0]), np.zeros(3)),))


def shift(x: float, y: float, z: float) -> Transform:
    return transform_from(np.eye(3), np.array([x, y, z], dtype=float))


def part(name: str, symmetries: Symmetries = Symmetries()) -> Part:  # noqa: B008 - frozen and empty
    corners = CORNERS * [0.02, 0.01, 0.01]
    faces = np.array([[0, 1, 3], [4, 6, 7]], dtype=np.int32)
    return Part(
        name=name,
        mesh=Mesh(corners, faces),
        keypoints=np.tile(corners, (3, 1))[:17],
        symmetries=symmetries,
        diameter=0.049,
        color=np.full(3, 128, dtype=np.uint8),
        detector_class=name,
    )


@pytest.fixture
def assembly() -> Assembly:
    """States: 0 base alone, 1 block, 2 block and pin, 3 all; error 4 after 1: pin in a wrong hole."""
    slide = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), slide=(-0.03, 0.03))
    base, block, pin, lid = np.eye(4), shift(0.1, 0, 0), shift(0, 0.1, 0), shift(0, 0, 0.1)
    wrong_hole = shift(0, -0.1, 0)
    joined = [
        {"base": base},
        {"base": base, "block": block},
        {"base": base, "block": block, "pin": pin},
        {"base": base, "block": block, "pin": pin, "lid": lid},
    ]
    joints = {"block": slide}
    states = [
        State(
            i,
            f"s{i}",
            poses,
            detector_class=f"toy:s{i}" if i else None,
            joints=joints if i else {},
        )
        for i, poses in enumerate(joined)
    ]
    error_poses = {"base": base, "block": block, "pin": wrong_hole}
    states.append(
        State(
            4,
            "wrong hole",
            error_poses,
            is_error=True,
            after=1,
            detector_class="toy:wrong",
            joints=joints,
        )
    )
    parts = {name: part(name, SPIN if name == "pin" else Symmetries()) for name in joined[3]}
    classes = (*parts, "toy:s1", "toy:s2", "toy:s3", "toy:wrong")
    transitions = frozenset({(0, 1), (1, 2), (2, 3), (1, 4), (4, 1)})
    return Assembly(
        "toy", "Toy", "base", parts, tuple(states), transitions, classes, "assembly.yaml"
    )


@pytest.fixture
def place() -> Callable[..., dict[str, PoseEstimate]]:
    """Put parts into the camera's view by their pose in the base part's frame."""
    T_camera_base = transform_from(
        rotation_about(np.array([0.3, 1.0, 0.2]), 0.8), np.array([0.1, 0, 0.7])
    )

    def make(Ts_base_part: Mapping[str, Transform]) -> dict[str, PoseEstimate]:
        return {
            name: PoseEstimate(name, T_camera_base @ T_base_part, 1.0, "refined")
            for name, T_base_part in Ts_base_part.items()
        }

    return make
