"""Where the nails of a hand are: a mark for each vertex, that the surface's detail draws them by.

The mark falls from 1 in a nail's middle over 0 at its rim, so that its outline is smooth between
vertices that lie farther apart than the rim is wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from asdfviz.geometry.shapes import Points, Vector

LONG, WIDE = 0.75, 0.80
"""Half a nail's length and width, in radii of the fingertip."""
ALONG = 0.80
"""Where its middle lies, as a share of the last bone."""
FAR = -3.0
"""The mark of what is on no nail."""


@dataclass(frozen=True, slots=True, eq=False)
class Fingertip:
    """The last bone of a finger, in the hand's frame."""

    start: Vector
    end: Vector
    radius: float
    """At its end, metres."""
    towards: Vector
    """Roughly where its back looks; what runs along the bone does not count."""


def nail_marks(vertices: Points, tips: Sequence[Fingertip]) -> Float64[np.ndarray, "n"]:
    """Return the mark of each vertex: 1 in the middle of a nail, 0 at its rim, below it elsewhere."""
    marks = np.full(len(vertices), FAR)
    for tip in tips:
        bone = tip.end - tip.start
        length = np.linalg.norm(bone)
        along = bone / length
        back = tip.towards - (tip.towards @ along) * along
        back = back / np.linalg.norm(back)
        beside = np.cross(along, back)
        away = vertices - (tip.start + ALONG * bone)
        u, v, w = away @ along, away @ beside, away @ back
        mark = 1 - (u / (LONG * tip.radius)) ** 2 - (v / (WIDE * tip.radius)) ** 2
        mark = np.where(w > 0, mark, FAR)
        marks = np.maximum(marks, np.maximum(mark, FAR))
    return marks
