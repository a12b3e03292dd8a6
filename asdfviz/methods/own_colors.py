"""What has quite another tint than a part surely had is another thing of its shape.

Not in the paper. A detector knows parts by their shapes, and takes the white end of a handle for a red
cap of that shape while a hand hides the cap. Light and shadow change how bright a surface is, hardly
how its red, green and blue stand to one another.
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
    """When the tint is another: of the logarithms of red, green and blue, less their mean."""

    enabled: bool = True
    """On or off."""
    unlike: float = 0.8
    """Greatest difference of one of the three: of 28 parts in four rendered sequences at right poses it
    was 0.64 at most between any two frames, but for a part of brass in an assembly's shadow; between red
    and white it is about 1.5."""
    rate: float = 0.2
    """Weight of a frame in what is known."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if self.unlike <= 0 or not 0 < self.rate <= 1:
            raise MethodError(
                f"own_colors.unlike is {self.unlike:g} and rate {self.rate:g}: unlike must be above 0, "
                "rate above 0 and at most 1"
            )


class OwnColors:
    """Remembers the tints of the parts of one sequence."""

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
            now = self._tint(frame, name, T)
            if now is None:
                continue
            known = self._known.setdefault(name, now)
            if _difference(now, known) <= self._config.unlike:
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
        """Those of some poses T_camera_part at which something of another tint is seen.

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
        """Whether something of another tint than a part's is seen at a pose.

        Only elsewhere than the part last surely was: there it may have come into another light.
        """
        part = self._parts[name]
        if point_distance(T_camera_part, T_last, part.middle) < part.diameter:
            return False
        off = self.difference(frame, name, T_camera_part)
        return off is not None and off > self._config.unlike

    def difference(self, frame: Frame, name: str, T_camera_part: Transform) -> float | None:
        """By how much the tint at a pose is another than the part's; None where nothing is known or seen."""
        known = self._known.get(name)
        now = None if known is None else self._tint(frame, name, T_camera_part)
        return None if known is None or now is None else _difference(now, known)

    def _tint(self, frame: Frame, name: str, T_camera_part: Transform) -> Vector | None:
        """Of what can be seen of a part; None where that is too little."""
        seen = self._surfaces[name].seen(frame, T_camera_part)
        return None if seen is None else tint(seen)


def _difference(now: Vector, known: Vector) -> float:
    return float(np.abs(now - known).max())
