"""Ways home that no straight line gives."""

from __future__ import annotations

import math

import numpy as np

from asdfviz.data.assembly import load_assembly
from asdfviz.geometry.transforms import transform_from
from asdfviz.synth.motion import moved
from asdfviz.synth.penetration import solid_of
from asdfviz.synth.primitives import box
from asdfviz.synth.ways import Body, deepest, find_way, is_free, with_steps

X, Z = np.eye(3)[0], np.eye(3)[2]
T_HIGH = transform_from(np.eye(3), np.array([0.0, 0.0, 0.3]))


def test_a_clip_goes_over_the_neck_and_then_along_it() -> None:
    vise = load_assembly("vise")
    poses = vise.steps[-1].T_base_part
    bodies = {n: Body(solid_of(vise.parts[n].mesh), T) for n, T in poses.items()}
    clip = bodies.pop("collar")
    others = list(bodies.values())
    straight = find_way(clip, others, [Z], T_HIGH)
    way = find_way(clip, others, [Z, X], T_HIGH)
    assert way.depth < straight.depth - 0.001
    assert way.corner is not None
    assert way.corner @ X > 0.008
    assert way.stops == (way.corner, way.out)
    for place in with_steps(way.stops):
        there = Body(clip.solid, moved(clip.T, place))
        assert deepest(there, others) < way.depth + 0.001


def test_a_body_is_free_up_to_the_depth_that_is_allowed() -> None:
    cube = solid_of(box((0.04, 0.04, 0.04)))
    here, others = (
        Body(cube, np.eye(4)),
        [Body(cube, moved(np.eye(4), s * X)) for s in (0.038, 0.033)],
    )
    exact = deepest(here, others)
    assert 0.006 < exact < 0.008
    assert is_free(here, others, exact)
    assert not is_free(here, others, math.nextafter(exact, 0.0))
    assert exact >= deepest(here, others, enough=0.001) >= 0.001
    assert deepest(here, others, enough=exact + 1e-9) == exact


def test_the_places_of_a_way_are_ends_and_what_lies_between() -> None:
    assert with_steps(()) == []
    places = with_steps((2 * X, 2 * X + 4 * Z))
    first = [0.5 * X, X, 1.5 * X, 2 * X]
    np.testing.assert_allclose(places, [*first, *(2 * X + k * Z for k in (1, 2, 3, 4))])
