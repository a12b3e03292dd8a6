"""The colours of parts, learnt where a part is surely seen, and how well a pixel goes with them.

Nothing is taken from the assembly's file, whose colours may be anybody's guess: a part of which no
colour was learnt says nothing. Colours are compared by hue and saturation first, since brightness
changes with the light.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt8

from asdfviz.geometry.shapes import Rotation, Scores
from asdfviz.state.color_kernels import ratio_of

DARK = 30.0
"""Added to the sum of the channels, so that the hue of what is nearly black counts little."""
VOLUME = 0.6 * 0.6 * 2.0
"""Of the colours that occur, in units of the features: what an unknown colour is compared with."""
LEAST_PIXELS = 12
"""Fewer teach no colour."""


@dataclass(frozen=True)
class ColorConfig:
    """How colours are learnt and compared; the paper has no such step."""

    spread: float = 0.03
    """Least standard deviation of hue and saturation within a part."""
    brightness: float = 0.35
    """Least standard deviation of the logarithm of the brightness: light and shade."""
    limit: float = 4.0
    """A pixel's colour speaks for or against a part by no more than this, natural logarithm."""
    apart: float = 2.0
    """A part's colours are learnt where they differ from those beside it by so many of these
    standard deviations."""
    frames: int = 40
    """A part's colours are learnt from so many frames,"""
    alike: int = 10
    """of those in which it lies alike no more than so many: turned otherwise, what shines looks otherwise."""
    alike_deg: float = 25.0
    """It lies alike that is turned by less than this against the camera, degrees."""
    least_frames: int = 2
    """And used after so many."""

    @property
    def least_spread(self) -> Scores:
        """Both standard deviations, in the order of the features."""
        return np.array([self.spread, self.spread, self.brightness])


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """The colours of a surface: medians and robust standard deviations of the features."""

    middle: Scores
    spread: Scores


class Looks:
    """What was learnt of every part; one for each sequence."""

    def __init__(self, *, config: ColorConfig) -> None:
        self._config = config
        self._learnt: dict[str, list[Look]] = {}
        self._turned: dict[str, list[Rotation]] = {}
        """How each part lay each time."""
        self._known: dict[str, Look] = {}
        """What `of` says of parts of which nothing was learnt since."""

    def is_wanted(self, name: str, R_camera_part: Rotation) -> bool:
        """Whether more is to be learnt of a part that lies so."""
        if len(self._learnt.get(name, ())) >= self._config.frames:
            return False
        return self._times(name, R_camera_part) < self._config.alike

    def _times(self, name: str, R_camera_part: Rotation) -> int:
        """How often it was learnt while it lay alike."""
        least = 1 + 2 * math.cos(math.radians(self._config.alike_deg))
        lain = self._turned.get(name, ())
        return sum(float((R * R_camera_part).sum()) > least for R in lain)

    def learn(
        self,
        name: str,
        rgb: UInt8[np.ndarray, "n 3"],
        *,
        around: UInt8[np.ndarray, "m 3"],
        R_camera_part: Rotation,
    ) -> None:
        """Take in pixels that show the part.

        Too few are passed over, and those that look like what lies around: a flat part that is
        taken for elsewhere than it is lies on the table there.

        Args:
            name: of the part.
            rgb: its pixels.
            around: pixels beside it.
            R_camera_part: how it lies.
        """
        look, beside = look_of(color_features(rgb)), look_of(color_features(around))
        if look is None or beside is None:
            return
        off = (look.middle - beside.middle) / self._config.least_spread
        if float(np.linalg.norm(off)) > self._config.apart:
            self._learnt.setdefault(name, []).append(look)
            self._turned.setdefault(name, []).append(R_camera_part)
            self._known.pop(name, None)

    def of(self, name: str) -> Look | None:
        """The part's look, the median over the frames; None before there are enough."""
        learnt = self._learnt.get(name, ())
        if len(learnt) < self._config.least_frames:
            return None
        if name not in self._known:
            middles = np.array([look.middle for look in learnt])
            middle = np.median(middles, axis=0)
            # It may look otherwise the next time, as much as it did before.
            between = 1.48 * np.median(np.abs(middles - middle), axis=0)
            within = np.median([look.spread for look in learnt], axis=0)
            self._known[name] = Look(middle, np.hypot(within, between))
        return self._known[name]


def color_features(rgb: UInt8[np.ndarray, "... 3"]) -> Float32[np.ndarray, "... 3"]:
    """Two numbers for hue and saturation, and the logarithm of the brightness."""
    channels = rgb.astype(np.float32)
    total = channels.sum(axis=-1)
    hue = (channels - total[..., None] / 3) / (total[..., None] + DARK)
    across = hue[..., 2] - hue[..., 1]
    return np.stack([np.float32(np.sqrt(2)) * hue[..., 0], across, np.log(total + DARK)], axis=-1)


def brightness(grey: float) -> float:
    """The third of `color_features` for a grey, 0 to 255."""
    return math.log(3 * grey + DARK)


def is_black(color: UInt8[np.ndarray, "3"], most: float) -> bool:
    """Whether a part's colour is no brighter than this, 0 to 255."""
    return float(color.mean()) <= most


def look_of(features: Float32[np.ndarray, "n 3"]) -> Look | None:
    """The look of pixels of one surface, none of them trusted alone; None where there are too few."""
    if len(features) < LEAST_PIXELS:
        return None
    middle = np.median(features, axis=0)
    spread = 1.48 * np.median(np.abs(features - middle), axis=0)
    return Look(middle.astype(np.float64), spread.astype(np.float64))


def color_ratio(
    look: Look, features: Float32[np.ndarray, "h w 3"], *, config: ColorConfig
) -> Float32[np.ndarray, "h w"]:
    """How much likelier each pixel's colour is on that surface than anywhere: natural logarithm."""
    deviation = np.sqrt(look.spread**2 + config.least_spread**2)
    highest = math.log(VOLUME / ((2 * math.pi) ** 1.5 * float(deviation.prod())))
    return ratio_of(features, look.middle, deviation, highest, float(config.limit))
