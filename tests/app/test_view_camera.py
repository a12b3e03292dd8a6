"""What the viewer's camera says of where its user looks."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from asdfviz.app import actions as act
from asdfviz.app.ar import ORBIT, look_rotation
from asdfviz.app.camera import looked_at
from asdfviz.app.drawings import wxyz_of
from asdfviz.app.view import Facts, View, window_of

K = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
FACTS = Facts(
    count=1,
    parts=("base",),
    boundaries=(),
    runs=(),
    preferred=None,
    has_truth=False,
    is_corrected=False,
    K=K,
    size_wh=(640, 480),
)
VIEW = View(zoom=2.0, aspect=1.5, centre=(400.0, 200.0))


def camera(
    turned: tuple[float, float], ahead: tuple[float, float], *, zoom: float = 2.0
) -> SimpleNamespace:
    """As viser reports it: the pixel that its rotation shows, and the one that its target does."""
    return SimpleNamespace(
        wxyz=wxyz_of(look_rotation(K, turned)),
        position=np.zeros(3),
        look_at=look_rotation(K, ahead)[:, 2] * ORBIT,
        fov=window_of(VIEW, FACTS).fov(zoom),
    )


def test_a_view_that_is_turned_by_hand_says_where_to() -> None:
    look = looked_at(camera((300.0, 250.0), (300.0, 250.0)), VIEW, FACTS)
    assert isinstance(look, act.Look)
    assert (look.u, look.v) == pytest.approx((300.0, 250.0))


def test_an_order_that_is_half_carried_out_says_nothing() -> None:
    """The new field of view comes at once, the turn with the next picture: nobody turned to the middle."""
    assert looked_at(camera((320.0, 240.0), (400.0, 200.0)), VIEW, FACTS) is None
    assert looked_at(camera((320.0, 240.0), (320.0, 240.0), zoom=1.0), VIEW, FACTS) is None
