"""Procedural surface textures: large maps that cover the whole view and small ones that repeat.

A map has four channels: two mixing weights between three colours, a brightness and a height. Large
maps lie over `MACRO_SIZE` metres and are mirrored beyond, so no seam is ever seen; small ones are
periodic by construction.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
from jaxtyping import Float32
from torch import Tensor

from asdfviz.synth.patterns import MACRO, MICRO, Map
from asdfviz.synth.tensors import to_tensor

MACRO_SIZE = 2.4
"""Metres that a large map covers."""
MICRO_SIZE = 0.2
"""Metres after which a small map repeats."""
MACRO_PIXELS = 1024
MICRO_PIXELS = 512
MACRO_KINDS = tuple(MACRO)
MICRO_KINDS = tuple(MICRO)
MACRO_VARIANTS, MICRO_VARIANTS = 4, 2
"""Maps of each kind."""
BLURS_PX = (0.0, 1.0, 2.2, 4.5, 9.0)
"""Small maps are kept at several blurs, chosen by the size of a pixel on the surface."""


@cache
def macro_map(kind: str, variant: int, device: str) -> Float32[Tensor, "5 n n"]:
    """A large map; the same kind and variant always give the same map."""
    rng = np.random.default_rng([MACRO_KINDS.index(kind), variant, 71])
    made = _with_slopes(MACRO[kind](rng, MACRO_PIXELS), MACRO_SIZE, mirrored=True)
    return to_tensor(made, device)


@cache
def micro_map(kind: str, variant: int, blur: int, device: str) -> Float32[Tensor, "5 n n"]:
    """A small periodic map, blurred by BLURS_PX[blur] pixels."""
    made = _sharp(kind, variant)
    if BLURS_PX[blur] > 0:
        pad = np.pad(made, ((0, 0), (32, 32), (32, 32)), mode="wrap").transpose(1, 2, 0)
        soft = cv2.GaussianBlur(pad, (0, 0), BLURS_PX[blur])
        made = np.ascontiguousarray(soft[32:-32, 32:-32].transpose(2, 0, 1))
    return to_tensor(made, device)


@cache
def _sharp(kind: str, variant: int) -> Float32[np.ndarray, "5 n n"]:
    """A small map before any blur."""
    rng = np.random.default_rng([MICRO_KINDS.index(kind), variant, 72])
    return _with_slopes(MICRO[kind](rng, MICRO_PIXELS), MICRO_SIZE, mirrored=False)


def build_maps(device: str) -> None:
    """Make all maps now, which otherwise the pictures do that first show them."""
    for kind in MACRO_KINDS:
        for variant in range(MACRO_VARIANTS):
            macro_map(kind, variant, device)
    for kind in MICRO_KINDS:
        for variant in range(MICRO_VARIANTS):
            for blur in range(len(BLURS_PX)):
                micro_map(kind, variant, blur, device)


def _with_slopes(made: Map, size: float, *, mirrored: bool) -> Float32[np.ndarray, "5 n n"]:
    """Channels first, the height replaced by its slopes along x and y."""
    height = made[:, :, 3]
    step = size / made.shape[0]
    mode = "edge" if mirrored else "wrap"
    padded = np.pad(height, 1, mode=mode)
    slope_x = (padded[1:-1, 2:] - padded[1:-1, :-2]) / (2 * step)
    slope_y = (padded[2:, 1:-1] - padded[:-2, 1:-1]) / (2 * step)
    return np.stack([made[:, :, 0], made[:, :, 1], made[:, :, 2], slope_x, slope_y]).astype(
        np.float32
    )
