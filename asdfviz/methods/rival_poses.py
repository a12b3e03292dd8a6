"""Whether a tracked part is where it was carried on to, or rather at another pose that fits.

What is clearly better is believed at once, what is a little better is watched: it has to be ahead for
some frames.
"""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter
from typing import TypeAlias

import numpy as np

from asdfviz.geometry.transforms import inverse
from asdfviz.methods.refinding import RefindConfig
from asdfviz.methods.track_memory import Rival, Track
from asdfviz.track.starts import Trial

Ahead: TypeAlias = Callable[[Trial, Trial], tuple[float, bool]]
"""By how much the second one fits better, and whether a single frame tells so."""


def decided(track: Track, best: Trial, jumps: list[Trial], ahead_of: Ahead) -> Trial:
    """The pose that carries on, or one that is clearly better; one a little better is watched.

    Args:
        track: of the part, whose rival is kept.
        best: the pose that carries on.
        jumps: poses that do not.
        ahead_of: compares two.
    """
    if not jumps:
        return best
    leads = [ahead_of(best, jump) for jump in jumps]
    (ahead, is_clear), jump = max(zip(leads, jumps, strict=True), key=itemgetter(0))
    if ahead > 0.0 and (track.is_new or is_clear):
        track.rival = None
        return jump
    least = 0.0 if track.rival is None else track.rival.ahead
    if ahead > least and track.explore:
        track.rival = Rival(inverse(best.T_camera_part) @ jump.T_camera_part, ahead)
    return best


def believed(
    track: Track, rival: Rival, best: Trial, trial: Trial, ahead_of: Ahead, *, config: RefindConfig
) -> Trial:
    """The rival, settled in this frame, once it has been ahead for long enough; it is forgotten when it
    falls behind."""
    ahead, _ = ahead_of(best, trial)
    rival.lead += float(np.clip(ahead, -config.step, config.step))
    if rival.lead > config.lead:
        track.rival = None
        return trial
    if rival.lead < -config.margin:
        track.rival = None
    rival.ahead = max(ahead, 0.0)
    rival.T_track_rival = inverse(best.T_camera_part) @ trial.T_camera_part
    return best
