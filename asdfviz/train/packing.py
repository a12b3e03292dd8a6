"""Fills a network input with tiles cut around single objects, or with one whole frame.

A frame shows a handful of objects on much empty table. Tiles put 20 to 35 objects into an input of
the same cost, which is what the keypoints need most.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32, Float64

from asdfviz.train.augment import Marks, marks_in, move_points, roll, similarity
from asdfviz.train.dataset import LabelledImage
from asdfviz.train.patches import ColorConfig, InputPlan, Patch, draw_colors

TILES = {64: 0.15, 96: 0.45, 128: 0.25, 192: 0.15}
"""Heights of tiles in pixels and how often they are drawn."""


@dataclass(frozen=True, slots=True)
class AugmentConfig:
    """How much a picture is changed."""

    roll_deg: float = 180.0
    """Camera roll up to +- this."""
    zoom: float = 1.35
    """Size factor from 1 / this to this."""
    shift: float = 0.1
    """Shift of whole frames, share of the input's side, +-."""
    center: float = 0.15
    """Distance of a tile's object from the tile's centre, share of the tile, +-."""
    states: float = 0.3
    """Share of tiles that are cut around the joined parts of a state: in tiles cut around parts a
    state is mostly cut off, and what is not labelled is taught to be nothing."""
    colors: ColorConfig = field(default_factory=ColorConfig)


class Packer:
    """Plans training inputs from a set of pictures."""

    def __init__(
        self, images: Sequence[LabelledImage], *, side: int, config: AugmentConfig
    ) -> None:
        """Index the objects by class.

        Args:
            images: the training set; their sizes may differ.
            side: longer side of every picture at zoom 1, input pixels: as a detector shows them.
            config: how much to change.
        """
        self.images = images
        self._side = side
        self._config = config
        parts: dict[int, list[tuple[int, int]]] = {}
        states: dict[int, list[tuple[int, int]]] = {}
        for i, image in enumerate(images):
            for j, item in enumerate(image.objects):
                pools = states if item.part is None else parts
                pools.setdefault(item.label, []).append((i, j))
        self._part_pools = [parts[label] for label in sorted(parts)]
        self._state_pools = [states[label] for label in sorted(states)]

    def frame(
        self, rng: np.random.Generator, *, width: int, height: int, spread: float
    ) -> InputPlan:
        """Return one whole frame, rolled, zoomed and shifted.

        Args:
            rng: all chance comes from it.
            width: of the input, pixels.
            height: of the input, pixels.
            spread: share of the full roll to use, 0 to 1.
        """
        index = int(rng.integers(len(self.images)))
        image = self.images[index]
        angle = self._angle(rng, spread)
        H_roll = roll(image.K, angle)
        size = np.array([image.rgb.shape[1], image.rgb.shape[0]], float)
        middle = H_roll[:2, :2] @ ((size - 1) / 2) + H_roll[:2, 2]
        window = np.array([width, height], float)
        shift = rng.uniform(-self._config.shift, self._config.shift, 2) * window
        zoom = self._scale(image) * self._zoom(rng)
        H = similarity(middle, (window - 1) / 2 + shift, zoom) @ H_roll
        patch, marks = self._patch(rng, index, H, (0, 0, width, height), angle)
        return InputPlan(width, height, (patch,), marks)

    def packed(
        self, rng: np.random.Generator, *, width: int, height: int, spread: float
    ) -> InputPlan:
        """Return an input full of tiles; arguments as for `frame`."""
        tiles = sorted(_tiles(rng, width, height), key=lambda t: t[2] * t[3], reverse=True)
        picks = [self._pick(rng) for _ in tiles]
        picks.sort(key=self._size, reverse=True)
        drawn = [self._tile(rng, pick, t, spread) for pick, t in zip(picks, tiles, strict=True)]
        marks = Marks.joined([m for _, m in drawn], [(x, y) for x, y, _, _ in tiles])
        return InputPlan(width, height, tuple(patch for patch, _ in drawn), marks)

    def _pick(self, rng: np.random.Generator) -> tuple[int, int]:
        is_state = bool(self._state_pools) and rng.random() < self._config.states
        pools = self._state_pools if is_state or not self._part_pools else self._part_pools
        pool = pools[int(rng.integers(len(pools)))]
        return pool[int(rng.integers(len(pool)))]

    def _size(self, pick: tuple[int, int]) -> float:
        image = self.images[pick[0]]
        return _extent(image.objects[pick[1]].outline) * self._scale(image)

    def _scale(self, image: LabelledImage) -> float:
        """Input pixels a pixel of the picture at zoom 1."""
        return self._side / max(image.rgb.shape[:2])

    def _tile(
        self,
        rng: np.random.Generator,
        pick: tuple[int, int],
        window: tuple[int, int, int, int],
        spread: float,
    ) -> tuple[Patch, Marks]:
        _, _, width, height = window
        image = self.images[pick[0]]
        angle = self._angle(rng, spread)
        H_roll = roll(image.K, angle)
        outline = move_points(H_roll, image.objects[pick[1]].outline)
        extent = _extent(outline)
        zoom = self._scale(image) * self._zoom(rng)
        side = min(width, height)
        if extent * zoom > 0.95 * side:
            zoom = side / extent * rng.uniform(0.7, 0.95)
        middle = (outline.min(0) + outline.max(0)).astype(np.float64) / 2
        free = np.array([width, height], float)
        target = (free - 1) / 2 + rng.uniform(-self._config.center, self._config.center, 2) * free
        H = similarity(middle, target, zoom) @ H_roll
        return self._patch(rng, pick[0], H, window, angle)

    def _patch(
        self,
        rng: np.random.Generator,
        index: int,
        H: Float64[np.ndarray, "3 3"],
        window: tuple[int, int, int, int],
        angle: float,
    ) -> tuple[Patch, Marks]:
        x, y, width, height = window
        r, g, b = (int(c) for c in rng.integers(0, 256, 3))
        colors = draw_colors(rng, self._config.colors)
        marks = marks_in(self.images[index], H, width=width, height=height, angle=angle)
        return Patch(index, H, x, y, width, height, (r, g, b), colors), marks

    def _angle(self, rng: np.random.Generator, spread: float) -> float:
        limit = math.radians(self._config.roll_deg) * spread
        return rng.uniform(-limit, limit)

    def _zoom(self, rng: np.random.Generator) -> float:
        limit = math.log(self._config.zoom)
        return math.exp(rng.uniform(-limit, limit))


def _extent(outline: Float32[np.ndarray, "h 2"]) -> float:
    return float((outline.max(0) - outline.min(0)).max())


def _tiles(rng: np.random.Generator, width: int, height: int) -> list[tuple[int, int, int, int]]:
    """Cut the input into bands of tiles: x, y, width, height of each."""
    tiles: list[tuple[int, int, int, int]] = []
    y = 0
    while y < height:
        fitting = [t for t in TILES if t <= height - y] or [height - y]
        weights = np.array([TILES.get(t, 1.0) for t in fitting])
        tall = int(rng.choice(fitting, p=weights / weights.sum()))
        if 0 < height - y - tall < min(TILES):
            tall = height - y
        count = max(1, width // tall)
        edges = np.linspace(0, width, count + 1).round().astype(int)
        for x0, x1 in itertools.pairwise(edges):
            tiles.append((int(x0), y, int(x1 - x0), tall))
        y += tall
    return tiles
