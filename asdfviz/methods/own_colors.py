"""What has quite another tint than a part surely had, or is far brighter or darker, is another thing of its shape.

Not in the paper. A detector knows parts by their shapes, and takes the white end of a handle for a red
cap of that shape while a hand hides the cap; a tracker follows a white part on a black glove. Light and shadow
change how bright a surface is, but not from white to black, and hardly how its red, green and blue stand to
one another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import point_distance
from asdfviz.methods.seen_colors import SeenSurface, tint
from asdfviz.state.twins import renamed


@dataclass(frozen=True)
class OwnColorsConfig:
    """When the colour is another: the tint, that is the logarithms of red, green and blue, less their mean, or
    that mean."""

    enabled: bool = True
    """On or off."""
    unlike: float = 0.8
    """Greatest difference of one of the three: of 28 parts in four rendered sequences at right poses it
    was 0.64 at most between any two frames, but for a part of brass in an assembly's shadow; between red
    and white it is about 1.5."""
    bright: float = 0.9
    """Greatest difference of brightness, in the mean of the logarithms: of 2,638 looks at parts at right poses in eight
    rendered sequences it was 0.59 at most, but for five at a black glove that lay on a white part, 1.4 to 1.6."""
    rate: float = 0.2
    """Weight of a frame in what is known."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not (self.unlike > 0 and self.bright > 0 and 0 < self.rate <= 1):
            raise MethodError(
                f"own_colors.unlike is {self.unlike:g}, bright {self.bright:g} and rate {self.rate:g}: all "
                "must be above 0, rate at most 1"
            )


class OwnColors:
    """Remembers the colours of the parts of one sequence."""

    def __init__(self, assembly: Assembly, *, config: OwnColorsConfig) -> None:
        """Begin a sequence."""
        self._config, self._parts = config, assembly.parts
        self._surfaces = {name: SeenSurface(part.mesh) for name, part in assembly.parts.items()}
        self._known: dict[str, Vector] = {}

    def see(self, frame: Frame, sure: Mapping[str, Transform]) -> None:
        """Remember how parts look that are surely at these poses T_camera_part."""
        if not self._config.enabled:
            return
        for name, T in sure.items():
            now = self._surfaces[name].seen(frame, T)
            if now is None:
                continue
            known = self._known.setdefault(name, now)
            if not self._is_unlike(now, known):
                self._known[name] = known + self._config.rate * (now - known)

    def rename(self, names: Mapping[str, str]) -> None:
        """From now on twins go by other names: from the old ones to the new."""
        self._known = renamed(self._known, names)

    def forget(self, names: frozenset[str]) -> None:
        """What was taken for these parts were others."""
        for name in names & self._known.keys():
            del self._known[name]

    def others(
        self, frame: Frame, poses: Mapping[str, Transform], last: Mapping[str, Transform]
    ) -> frozenset[str]:
        """Those of some poses T_camera_part at which something of another colour is seen.

        Args:
            frame: the new frame.
            poses: T_camera_part in it.
            last: those where the parts last surely were; of others nothing is known.
        """
        asked = poses.keys() & last.keys()
        return frozenset(n for n in asked if self.is_other(frame, n, poses[n], last[n]))

    def is_other(
        self, frame: Frame, name: str, T_camera_part: Transform, T_last: Transform
    ) -> bool:
        """Whether something of another colour than a part's is seen at a pose.

        Only elsewhere than the part last surely was: there it may have come into another light.
        """
        part = self._parts[name]
        if point_distance(T_camera_part, T_last, part.middle) < part.diameter:
            return False
        known = self._known.get(name)
        now = None if known is None else self._surfaces[name].seen(frame, T_camera_part)
        return known is not None and now is not None and self._is_unlike(now, known)

    def difference(self, frame: Frame, name: str, T_camera_part: Transform) -> float | None:
        """By how much the tint at a pose is another than the part's; None where nothing is known or seen."""
        known = self._known.get(name)
        now = None if known is None else self._surfaces[name].seen(frame, T_camera_part)
        return None if known is None or now is None else _difference(now, known)

    def _is_unlike(self, now: Vector, known: Vector) -> bool:
        """Whether two colours are not of one part."""
        config, brighter = self._config, abs(float(now.mean() - known.mean()))
        return brighter > config.bright or _difference(now, known) > config.unlike


def _difference(a: Vector, b: Vector) -> float:
    """Greatest difference of the tints of two colours."""
    return float(np.abs(tint(a) - tint(b)).max())
