from __future__ import annotations

import numpy as np

from asdfviz.detector.nms import suppress


def test_the_weaker_of_two_boxes_of_a_class_goes() -> None:
    boxes = np.array([[0, 0, 10, 10], [1, 0, 11, 10], [1, 0, 11, 10], [30, 0, 40, 10.0]])
    scores = np.array([0.5, 0.9, 0.4, 0.3])
    labels = np.array([0, 0, 1, 0])
    assert suppress(boxes, scores, labels, iou=0.5, limit=10).tolist() == [1, 2, 3]
    assert suppress(boxes, scores, labels, iou=0.5, limit=1).tolist() == [1]


def test_a_suppressed_box_suppresses_nobody() -> None:
    boxes = np.array([[0, 0, 10, 10], [4, 0, 14, 10], [8, 0, 18, 10.0]])
    scores = np.array([0.9, 0.8, 0.7])
    assert suppress(boxes, scores, np.zeros(3, np.int64), iou=0.4, limit=9).tolist() == [0, 2]


def test_nothing_stays_nothing() -> None:
    found = suppress(np.zeros((0, 4)), np.zeros(0), np.zeros(0, np.int64), iou=0.5, limit=5)
    assert found.shape == (0,)
