"""Where a tracked part goes on to."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.methods.refinding import carried_on
from asdfviz.methods.track_memory import Track, with_turned_axes

START = transform_from(np.eye(3), np.array([0.0, 0.0, 0.5]))


def turned_by(angle: float) -> np.ndarray:
    R = rotation_about(np.array([1.0, 0.0, 0.0]), angle)
    return transform_from(R, np.array([0.02, 0.0, 0.5]))


@pytest.mark.parametrize(("angle", "goes_on"), [(0.2, True), (np.pi, False)])
def test_a_part_moves_on_as_it_moved_but_is_not_turned_round_again(
    angle: float, goes_on: bool
) -> None:
    """Twelve degrees a frame are motion; half a turn was a mistake put right."""
    track = Track(START)
    track.take(START)
    track.take(turned_by(angle))
    starts = carried_on(track, None, centre=np.zeros(3))
    assert len(starts) == 1 + goes_on
    assert np.array_equal(starts[0], turned_by(angle))
    if goes_on:
        np.testing.assert_allclose(starts[1][:3, 3], [0.04, 0.0, 0.5], atol=5e-3)


def test_a_part_that_others_put_elsewhere_is_looked_for_where_it_last_surely_was() -> None:
    track = Track(START)
    track.take(turned_by(0.1))
    track.unsure, track.T_before, track.T_now = 3, None, START
    starts = carried_on(track, None, centre=np.zeros(3))
    assert [T.tolist() for T in starts] == [START.tolist(), turned_by(0.1).tolist()]
    track.unsure = 0  # nobody doubts where it is
    assert len(carried_on(track, None, centre=np.zeros(3))) == 1


def test_where_a_part_surely_was_has_the_axes_that_it_goes_by_now() -> None:
    track = Track(START)
    assert with_turned_axes(track, turned_by(1.0)).T_sure is None
    track.take(START)
    turned = with_turned_axes(track, turned_by(1.0))
    assert turned.T_sure is not None
    np.testing.assert_allclose(turned.T_sure, turned.T_now)


def test_nothing_is_known_of_the_motion_of_what_was_lost() -> None:
    track = Track(START)
    track.take(START)
    track.unsure, track.missing = 2, 1
    track.take(turned_by(0.1))
    assert track.T_before is None
    assert (track.unsure, track.missing, track.age) == (0, 0, 2)
