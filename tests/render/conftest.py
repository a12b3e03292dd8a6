"""A renderer for the tests; where OpenGL is missing they skip, in CI they fail."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from asdfviz.datatypes import KEYPOINTS, Assembly, Mesh, Part, State
from asdfviz.errors import RenderError
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.render.renderer import Renderer


def _open(width: int, height: int) -> Renderer:
    try:
        return Renderer(width, height)
    except RenderError as error:
        if os.environ.get("CI", "").lower() in ("1", "true"):
            pytest.fail(f"CI must have EGL: {error}")
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def open_renderer() -> Callable[[int, int], Renderer]:
    """Opens a renderer that the caller closes."""
    return _open


@pytest.fixture(scope="session")
def renderer() -> Iterator[Renderer]:
    """160 x 120 pixels."""
    opened = _open(160, 120)
    yield opened
    opened.close()


@pytest.fixture(scope="session")
def K() -> np.ndarray:
    """Intrinsics of the 160 x 120 renderer, off centre on purpose."""
    return np.array([[150.0, 0.0, 83.2], [0.0, 140.0, 55.7], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="session")
def box() -> Mesh:
    """10 cm x 6 cm x 4 cm about the origin, outward faces."""
    x, y, z = 0.05, 0.03, 0.02
    corners = np.array([[i, j, k] for i in (-x, x) for j in (-y, y) for k in (-z, z)])
    faces = [
        (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
        (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
    ]  # fmt: skip
    return Mesh(corners, np.array(faces, dtype=np.int32))


def _part(name: str, mesh: Mesh, color: tuple[int, int, int]) -> Part:
    return Part(
        name=name,
        mesh=mesh,
        keypoints=np.zeros((KEYPOINTS, 3)),
        symmetries=Symmetries(),
        diameter=0.12,
        color=np.array(color, dtype=np.uint8),
        detector_class=name,
    )


@pytest.fixture(scope="session")
def assembly(box: Mesh) -> Assembly:
    """Two boxes of one shape: "red" is the base, "black" stands 10 cm beside it."""
    parts = {"red": _part("red", box, (210, 30, 30)), "black": _part("black", box, (10, 10, 10))}
    beside = np.eye(4)
    beside[0, 3] = 0.1
    states = (
        State(0, "red", {"red": np.eye(4)}),
        State(1, "both", {"red": np.eye(4), "black": beside}, detector_class="boxes:both"),
    )
    return Assembly(
        "boxes",
        "Boxes",
        "red",
        parts,
        states,
        frozenset({(0, 1)}),
        ("red", "black", "boxes:both"),
        "",
    )
