"""The colour of an assembly's progress, the same in the app and in reports. Pure."""

from __future__ import annotations

import numpy as np

Rgb3 = tuple[int, int, int]

# Indigo to light yellow: lightness rises with progress, so the order shows without the hue.
_RAMP = np.array(
    [
        (98, 92, 170),
        (74, 116, 184),
        (58, 142, 178),
        (44, 164, 156),
        (84, 190, 122),
        (152, 212, 90),
        (238, 230, 96),
    ],
    float,
)


def state_color(index: int, count: int) -> Rgb3:
    """Colour of correct state `index` of `count`: dark when little is done, light at the end."""
    share = index / max(count - 1, 1) * (len(_RAMP) - 1)
    low = min(int(share), len(_RAMP) - 2)
    r, g, b = (round(float(v)) for v in _RAMP[low] + (share - low) * (_RAMP[low + 1] - _RAMP[low]))
    return r, g, b
