"""Whether the colours of a picture are divided as a drawn pose of a part has it.

What all poses of a part cover shows its colours, what lies around them those behind it. Where one pose
has the part and another has not, the picture's own colours say which of them is right: depth smeared by
the camera fills what is narrow, a silhouette does not.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float64

from asdfviz.geometry.shapes import Rgb
from asdfviz.methods.color_odds import mean_odds
from asdfviz.methods.group_views import grown
from asdfviz.methods.seen_colors import log_colors

BESIDE = 3
"""Pixels beside the outlines that may show a mixture, or the part;"""
AROUND = 8
"""those beyond them, up to here, show what is behind it."""
LEAST, LEAST_AROUND = 10, 30
"""Fewer pixels tell nothing."""
SPREAD = 0.1
"""Least deviation of the logarithm of colours."""
LIGHT = 0.25
"""That of brightness alone: shading and shadows, of which the samples show some."""
SUREST = 3.0
"""No pixel counts for more than these log-odds."""


def divided_so(
    rgb: Rgb, drawn: Bool[np.ndarray, "n h w"], hidden: Bool[np.ndarray, "h w"]
) -> Float64[np.ndarray, "n"]:
    """Mean log-odds with which the pixels about a part show it where each pose has it, and not elsewhere.

    Args:
        rgb: the picture around the poses.
        drawn: where each pose has the part.
        hidden: where something nearer is.

    Returns:
        0 for all where too little of the part, or of what is behind it, is known.
    """
    any_of_them = np.any(drawn, axis=0)
    all_of_them = np.all(drawn, axis=0)
    group = any_of_them.astype(np.uint8)
    around = grown(group, AROUND) & ~grown(group, BESIDE) & ~hidden
    inside = cv2.erode(all_of_them.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    common = inside & ~hidden
    if np.count_nonzero(common) < LEAST:
        common = all_of_them & ~hidden
    if np.count_nonzero(common) < LEAST or np.count_nonzero(around) < LEAST_AROUND:
        return np.zeros(len(drawn))
    asked = any_of_them & ~hidden
    return mean_odds(log_colors(rgb), drawn, asked, common, around, SPREAD, LIGHT, SUREST)
