"""A toy assembly of boxes, so that the generator is tested without any file."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Joint, Part, State
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.primitives import box


def _part(name: str, size: tuple[float, float, float], color: tuple[int, int, int]) -> Part:
    mesh = box(size)
    keypoints = np.resize(mesh.vertices, (17, 3)).astype(np.float64)
    return Part(
        name,
        mesh,
        keypoints,
        Symmetries(),
        float(np.linalg.norm(size)),
        np.array(color, np.uint8),
        name,
    )


def _at(x: float, y: float, z: float, turn: float = 0.0) -> np.ndarray:
    return transform_from(rotation_about(np.array([0.0, 0.0, 1.0]), turn), np.array([x, y, z]))


@pytest.fixture(scope="session")
def toy() -> Assembly:
    parts = {
        "plate": _part("plate", (0.1, 0.08, 0.02), (20, 60, 190)),
        "block": _part("block", (0.03, 0.04, 0.03), (220, 120, 30)),
        "bar": _part("bar", (0.02, 0.07, 0.015), (230, 230, 225)),
    }
    on_plate = {"plate": np.eye(4), "block": _at(-0.02, 0.0, 0.025)}
    joints = {
        "block": Joint("prismatic", np.array([0.0, 1.0, 0.0]), np.zeros(3), slide=(-0.01, 0.01))
    }
    states = (
        State(0, "plate", {"plate": np.eye(4)}),
        State(1, "block", on_plate, joints=joints),
        State(2, "bar", {**on_plate, "bar": _at(0.03, 0.0, 0.0175)}, joints=joints),
        State(
            3, "block_turned", {"plate": np.eye(4), "block": _at(0.02, 0.0, 0.025, 1.2)}, True, 0
        ),
    )
    return Assembly(
        "toy",
        "Toy",
        "plate",
        parts,
        states,
        frozenset({(0, 1), (1, 2), (0, 3), (3, 0)}),
        tuple(parts),
        "",
    )


@pytest.fixture(scope="session")
def toy_assets(toy: Assembly) -> Assets:
    return load_assets(toy)


@pytest.fixture(scope="module")
def toy_loaded_once(toy_assets: Assets) -> Iterator[None]:
    """Meshes and resting faces are the same for every job on the toy."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("images", "sequences"):
            patch.setattr(
                f"asdfviz.synth.{module}.load_assets",
                lambda assembly, device: replace(toy_assets, assembly=assembly),
            )
        yield
