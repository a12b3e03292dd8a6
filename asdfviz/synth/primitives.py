"""Simple solids for distractors; a scene stretches them by affine transforms."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Mesh

Profile = Float64[np.ndarray, "k 2"]


def lathe(profile: Profile, *, segments: int = 28) -> Mesh:
    """Turn a profile of (radius, z) about z."""
    angle = np.arange(segments) * 2 * np.pi / segments
    k = len(profile)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    xy = profile[None, :, :1] * ring[:, None]
    z = np.broadcast_to(profile[None, :, 1:], (segments, k, 1))
    vertices = np.concatenate([xy, z], axis=2).reshape(-1, 3)
    i = np.arange(segments)[:, None]
    j = np.arange(k - 1)[None]
    a, b = i * k + j, (i + 1) % segments * k + j
    quads = np.stack([a, b, b + 1, a + 1], axis=-1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return Mesh(vertices.astype(np.float64), faces.astype(np.int32))


def prism(outline: Profile, *, height: float = 1.0) -> Mesh:
    """Extrude a star-shaped outline (about its mean) from -height/2 to height/2."""
    k = len(outline)
    bottom = np.column_stack([outline, np.full(k, -height / 2)])
    top = np.column_stack([outline, np.full(k, height / 2)])
    mean = outline.mean(axis=0)
    caps = np.array([[*mean, -height / 2], [*mean, height / 2]])
    i = np.arange(k)
    j = (i + 1) % k
    faces = np.concatenate(
        [
            np.stack([i, j, j + k], axis=1),
            np.stack([i, j + k, i + k], axis=1),
            np.stack([np.full(k, 2 * k), j, i], axis=1),
            np.stack([np.full(k, 2 * k + 1), i + k, j + k], axis=1),
        ]
    )
    return Mesh(np.concatenate([bottom, top, caps]).astype(np.float64), faces.astype(np.int32))


def box(size: tuple[float, float, float]) -> Mesh:
    """A box about the origin with the given edges."""
    unit = prism(np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]))
    return Mesh(unit.vertices * np.array(size), unit.faces)


def _regular(k: int) -> Profile:
    angle = np.arange(k) * 2 * np.pi / k
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * 0.5


def _l_shape() -> Profile:
    return np.array(
        [[-0.5, -0.5], [0.5, -0.5], [0.5, -0.15], [-0.15, -0.15], [-0.15, 0.5], [-0.5, 0.5]]
    )


def _gear(teeth: int) -> Profile:
    angle = np.arange(teeth * 4) * 2 * np.pi / (teeth * 4)
    radius = np.where(np.arange(teeth * 4) % 4 < 2, 0.5, 0.4)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius[:, None]


def _torus() -> Mesh:
    a = np.linspace(0, 2 * np.pi, 15)
    return lathe(np.stack([0.36 + 0.14 * np.cos(a), 0.14 * np.sin(a)], axis=1))


def _ball() -> Mesh:
    a = np.linspace(-np.pi / 2, np.pi / 2, 15)
    return lathe(np.stack([0.5 * np.cos(a), 0.5 * np.sin(a)], axis=1))


@cache
def distractor_meshes() -> Sequence[Mesh]:
    """Solids about one unit large: boxes, bolts, rings, cups, a bottle, gears, a handle."""
    p = np.array
    return (
        box((1.0, 1.0, 1.0)),
        prism(_regular(6)),
        prism(_regular(32)),
        prism(_l_shape()),
        prism(_gear(14), height=0.4),
        _torus(),
        _ball(),
        lathe(p([[0.25, -0.4], [0.5, -0.4], [0.5, 0.4], [0.25, 0.4], [0.25, -0.4]])),
        lathe(p([[0, -0.5], [0.4, -0.5], [0.5, 0.5], [0.45, 0.5], [0.36, -0.42], [0, -0.42]])),
        lathe(p([[0, -0.5], [0.22, -0.5], [0.22, 0.1], [0.1, 0.25], [0.1, 0.5], [0, 0.5]])),
        lathe(
            p(
                [
                    [0, -0.5],
                    [0.16, -0.5],
                    [0.2, -0.2],
                    [0.14, 0.05],
                    [0.05, 0.08],
                    [0.04, 0.5],
                    [0, 0.5],
                ]
            )
        ),
        lathe(p([[0, -0.5], [0.3, -0.5], [0.3, -0.3], [0.12, -0.3], [0.12, 0.5], [0, 0.5]])),
        lathe(p([[0, 0.0], [0.5, 0.06], [0.5, 0.1], [0.46, 0.1], [0.4, 0.07], [0, 0.03]])),
    )
