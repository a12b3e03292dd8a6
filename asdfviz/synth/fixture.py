"""A block under a base that cannot stand by itself, for sequences without hands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply
from asdfviz.pose.resting import CONTACT
from asdfviz.synth.assets import Assets
from asdfviz.synth.description import Placed
from asdfviz.synth.looks import plastic, random_hue
from asdfviz.synth.penetration import Solid
from asdfviz.synth.ways import Body

_SIDES = (0.06, 0.045, 0.03, 0.02, 0.012)
_BOX = 0
"""Place of the unit box among the distractors."""


def find_fixture(
    assets: Assets,
    base: Solid,
    T_world_base: Transform,
    others: Sequence[Body],
    rng: np.random.Generator,
) -> Placed:
    """The widest block under the base's lowest points that no joined part goes through.

    Args:
        assets: has the box.
        base: the base part.
        T_world_base: where it is; its lowest points are over the table.
        others: places of all that is ever joined, world.
        rng: chooses a colour.
    """
    world = apply(T_world_base, base.samples)
    floor = float(world[:, 2].min())
    contacts = world[world[:, 2] < floor + CONTACT]
    middle = contacts.mean(axis=0)
    spots = contacts[np.argsort(np.linalg.norm(contacts - middle, axis=1))]
    below = np.concatenate(
        [p[p[:, 2] < floor] for p in (apply(b.T, b.solid.samples) for b in others)]
    )
    chosen = (middle, _SIDES[-1])
    for side in _SIDES:
        gaps = np.abs(spots[:, None, :2] - below[None, :, :2]).max(axis=2) - side / 2
        free = (gaps > 0.002).all(axis=1)
        if bool(free.any()):
            chosen = (spots[int(free.argmax())], side)
            break
    at, side = chosen
    T = np.diag([side, side, floor, 1.0])
    T[:3, 3] = [at[0], at[1], floor / 2]
    return Placed(assets.distractors[_BOX], T, plastic(random_hue(rng), rng), "distractor")
