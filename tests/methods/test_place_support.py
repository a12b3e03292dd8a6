from __future__ import annotations

import numpy as np

from asdfviz.methods.place_support import PlaceSupport, SupportConfig

HERE, THERE = np.array([0.0, 0, 0.6]), np.array([0.2, 0, 0.6])
CONFIG = SupportConfig()


def hear(support: PlaceSupport, detected: np.ndarray, score: float, is_sure: bool = True) -> bool:
    support.fade(CONFIG)
    return support.hear(HERE, detected, score=score, diameter=0.05, is_sure=is_sure, config=CONFIG)


def frames_until_believed(support: PlaceSupport, detected: np.ndarray, score: float) -> int | None:
    return next((i for i in range(1, 60) if hear(support, detected, score)), None)


def test_a_part_that_is_kept_being_found_elsewhere_is_believed() -> None:
    assert frames_until_believed(PlaceSupport(), THERE, 0.8) == 2
    # Poor boxes need longer, very poor ones never do it.
    slow = frames_until_believed(PlaceSupport(), THERE, 0.3)
    assert slow is not None
    assert slow > 8
    assert frames_until_believed(PlaceSupport(), THERE, 0.15) is None


def test_what_was_found_where_it_is_tracked_resists() -> None:
    support = PlaceSupport()
    assert not any(hear(support, 1.01 * HERE, 0.8) for _ in range(10))
    count = frames_until_believed(support, THERE, 0.8)
    assert count is not None
    assert count > 4


def test_a_track_that_is_lost_follows_even_poor_boxes() -> None:
    support = PlaceSupport()
    heard = [hear(support, THERE, 0.15, is_sure=False) for _ in range(10)]
    assert heard[0] is False, "a single one is no reason"
    assert any(heard)
    # What was surely found where it is tracked was not moved because a hand covers it now.
    known = PlaceSupport()
    assert not any(hear(known, 1.01 * HERE, 0.8) for _ in range(10))
    assert not any(hear(known, THERE, 0.15, is_sure=False) for _ in range(10))


def test_scattered_boxes_support_no_place() -> None:
    support = PlaceSupport()
    rng = np.random.default_rng(0)
    assert not any(hear(support, rng.uniform(1, 9, 3), 0.6) for _ in range(40))
