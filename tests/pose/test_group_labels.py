"""Which groups of joined parts get a state's label: by what is seen of all that they cover."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from asdfviz.data.scene_objects import SceneObject
from asdfviz.datatypes import Assembly, Mesh, Part, State
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import transform_from
from asdfviz.pose.labels import SMALLEST_VISIBLE, Group, LabelledObject, Labeller, Subject

K = np.array([[200.0, 0, 159.5], [0, 200.0, 89.5], [0, 0, 1]])


def plate(name: str, width: float, height: float) -> Part:
    vertices = np.array(list(product((0.0, width), (0.0, height), (0.0, 0.001))))
    return Part(
        name=name,
        mesh=Mesh(vertices, np.array([[0, 2, 6], [0, 6, 4]], dtype=np.int32)),
        keypoints=np.resize(vertices, (17, 3)),
        symmetries=Symmetries(),
        diameter=float(np.hypot(width, height)),
        color=np.zeros(3, dtype=np.uint8),
        detector_class=name,
    )


PARTS = {
    "plate": plate("plate", 0.1, 0.1),
    "chip": plate("chip", 0.04, 0.05),
    "other": plate("other", 0.1, 0.1),
}


def labels(
    poses: dict[str, tuple[float, float, float]], shares: dict[str, float | None]
) -> dict[str | None, LabelledObject]:
    """The labels of parts at places in metres, all joined, by part; None is the state."""
    joined = dict.fromkeys(poses, np.eye(4))
    states = (
        State(0, "bare", {"plate": np.eye(4)}),
        State(1, "joined", joined, detector_class="toy:joined"),
    )
    toy = Assembly(
        "toy",
        "Toy",
        "plate",
        PARTS,
        states,
        frozenset({(0, 1)}),
        (*PARTS, "toy:joined"),
        "/toy.yaml",
    )
    objects = tuple(
        SceneObject(name, transform_from(np.eye(3), np.array(place)), shares[name])
        for name, place in poses.items()
    )
    labeller = Labeller(Subject.of(toy), K, (320, 180), None, SMALLEST_VISIBLE)
    return {label.part: label for label in labeller.labels(objects, (Group("joined", None),))}


@pytest.mark.parametrize(
    ("plate", "chip", "expected"),
    [
        pytest.param(1.0, 0.0, 1.0, id="the plate covers the chip"),
        pytest.param(0.8, 1.0, 1.0, id="the chip lies before the plate"),
        pytest.param(None, None, 1.0, id="nobody said how much is seen"),
        pytest.param(0.5, 0.0, 0.5, id="a hand before half of the plate, the chip behind it"),
        pytest.param(0.15, 0.0, None, id="a hand before nearly all"),
        pytest.param(0.0, 0.9, None, id="the chip alone is seen"),
    ],
)
def test_what_joined_parts_cover_of_each_other_hides_nothing_of_their_state(
    plate: float | None, chip: float | None, expected: float | None
) -> None:
    poses = {"plate": (-0.05, -0.05, 0.5), "chip": (-0.02, -0.025, 0.501)}
    found = labels(poses, {"plate": plate, "chip": chip})
    seen = {name for name, s in (("plate", plate), ("chip", chip)) if s is None or s >= 0.2}
    assert set(found) - {None} == seen
    if expected is None:
        assert None not in found
    else:
        assert found[None].visible == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("shares", "expected"), [((0.0, 0.5), 0.25), ((0.0, 0.3), None), ((0.6, 1.0), 0.8)]
)
def test_parts_beside_each_other_count_by_their_size(
    shares: tuple[float, float], expected: float | None
) -> None:
    poses = {"plate": (-0.11, -0.05, 0.5), "other": (0.01, -0.05, 0.5)}
    found = labels(poses, dict(zip(poses, shares, strict=True)))
    assert (None in found) == (expected is not None)
    if expected is not None:
        assert found[None].visible == pytest.approx(expected, abs=0.01)


def test_what_lies_outside_the_picture_is_not_seen() -> None:
    poses = {"plate": (-0.45, -0.05, 0.5), "other": (-0.85, -0.05, 0.5)}
    found = labels(poses, {"plate": 0.5, "other": 0.0})
    assert found[None].visible == pytest.approx(0.25, abs=0.01)
    assert None not in labels(poses, {"plate": 0.3, "other": 0.0})
