from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.boxes import (
    beside,
    box_around,
    box_middle,
    iou_matrix,
    is_in_view,
    longer_side,
    overlap,
    share_inside,
)


def test_iou_of_known_boxes() -> None:
    boxes = np.array([[0, 0, 2, 2], [1, 0, 3, 2], [5, 5, 6, 6], [4, 4, 4, 4.0]])
    wanted = [[1, 1 / 3, 0, 0], [1 / 3, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 0]]
    np.testing.assert_allclose(iou_matrix(boxes, boxes), wanted)
    for i, a in enumerate(boxes[:3]):
        assert [overlap(a, b) for b in boxes[:3]] == pytest.approx(wanted[i][:3])


def test_the_share_inside_counts_one_box_alone() -> None:
    small, large = np.array([0, 0, 2, 2.0]), np.array([1, 0, 9, 9.0])
    assert share_inside(small, large) == pytest.approx(1 / 2)
    assert share_inside(large, small) == pytest.approx(2 / 72)
    assert share_inside(small, small + 5) == 0


def test_a_box_is_in_view_where_its_middle_is() -> None:
    box = box_around(np.array([[-9, 2], [3, 8], [5, 4.0]]))
    assert box.tolist() == [-9, 2, 5, 8]
    assert box_middle(box).tolist() == [-2, 5]
    assert not is_in_view(box, (20, 10))
    assert is_in_view(box + 2, (20, 10)), "its middle lies on the edge"
    assert not is_in_view(box + 5, (20, 10))


def test_a_box_is_moved_by_a_share_of_its_longer_side() -> None:
    box = np.array([10, 20, 14, 28.0])
    assert longer_side(box) == 8
    moved = [near - box for near in beside(box, 0.25)]
    np.testing.assert_allclose(moved, [[2, 0, 2, 0], [-2, 0, -2, 0], [0, 2, 0, 2], [0, -2, 0, -2]])
