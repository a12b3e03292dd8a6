from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Detection
from asdfviz.state.appearance import AppearanceConfig, appearance_probabilities


def box(label: str, score: float) -> Detection:
    return Detection(label, np.array([0.0, 0, 9, 9]), np.zeros((17, 2)), np.ones(17), score)


def looks(assembly: Assembly, *boxes: tuple[str, float], **options) -> np.ndarray | None:
    detections = [box(*entry) for entry in boxes]
    return appearance_probabilities(detections, assembly, config=AppearanceConfig(**options))


def without_classes(assembly: Assembly, *indices: int) -> Assembly:
    states = tuple(
        dataclasses.replace(s, detector_class=None) if s.index in indices else s
        for s in assembly.states
    )
    return dataclasses.replace(assembly, states=states)


@pytest.mark.parametrize(
    ("boxes", "expected"),
    [
        ([("base", 0.9)], 0),
        ([("toy:s2", 0.8)], 2),
        ([("base", 0.9), ("toy:s2", 0.4), ("toy:s3", 0.7)], 3),
        ([("toy:s1", 0.5), ("toy:s2", 0.7), ("toy:s1", 0.9)], 1),
        ([("toy:wrong", 0.9), ("toy:s1", 0.3)], 4),
    ],
)
def test_the_best_state_box_decides(assembly: Assembly, boxes, expected: int) -> None:
    probabilities = looks(assembly, *boxes)
    assert probabilities is not None
    assert probabilities.sum() == pytest.approx(1.0)
    assert (probabilities > 0).all()
    assert int(probabilities.argmax()) == expected


def test_nothing_in_the_picture_says_nothing(assembly: Assembly) -> None:
    assert looks(assembly) is None
    assert looks(assembly, ("block", 0.9)) is None


def test_no_state_classes_say_nothing(assembly: Assembly) -> None:
    assert looks(without_classes(assembly, 1, 2, 3, 4), ("base", 0.9)) is None


def test_state_0_gets_what_the_boxes_leave(assembly: Assembly) -> None:
    shares = []
    for score in (0.0, 0.3, 0.6, 0.9):
        probabilities = looks(assembly, ("base", 0.9), ("toy:s1", score))
        assert probabilities is not None
        shares.append(probabilities[0])
    assert shares == sorted(shares, reverse=True)
    expected = np.exp(np.array([0.5 * 0.4, 0.6, 0, 0, 0]) / 0.2)
    probabilities = looks(assembly, ("toy:s1", 0.6), absence=0.5)
    assert probabilities == pytest.approx(expected / expected.sum())


def test_an_error_without_a_class_looks_like_the_state_it_follows(assembly: Assembly) -> None:
    probabilities = looks(without_classes(assembly, 4), ("toy:s1", 0.8))
    assert probabilities is not None
    assert probabilities[4] == pytest.approx(probabilities[1])
    assert int(probabilities.argmax()) == 1


def test_a_low_temperature_is_more_certain(assembly: Assembly) -> None:
    cold = looks(assembly, ("toy:s2", 0.6), temperature=0.05)
    warm = looks(assembly, ("toy:s2", 0.6), temperature=0.5)
    assert cold is not None
    assert warm is not None
    assert cold[2] > warm[2]
