"""Twins (`asdfviz.state.twins`) in evaluation: parts that no camera can tell apart.

By name, a pose that lies on the other twin is wrong. BOP knows one object with several instances
instead; `exchanged` gives the poses of twins to the true ones frame by frame, for the figures whose
names end in `_twins`, and `asdfviz.evaluate.bop` does as BOP does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from asdfviz.datatypes import PoseEstimate
from asdfviz.evaluate.pose_errors import ErrorModel, add_s, add_s_at_least
from asdfviz.geometry.matching import cheapest_pairs
from asdfviz.geometry.shapes import Transform

FAR = 0.1
"""Metres of ADD(S): a pose farther off is wrong for every twin alike, so it counts no more than this."""
OWN_NAME = 1e-9
"""Metres by which a pose's own name is preferred where both fit as well."""


def exchanged(
    poses: Mapping[str, PoseEstimate],
    truth: Mapping[str, Transform],
    names: Sequence[str],
    model: ErrorModel,
    *,
    measured: dict[tuple[str, str], float] | None = None,
) -> dict[str, PoseEstimate]:
    """Give the poses of twins to the true ones with the least sum of ADD(S), none of it above FAR.

    Poses that are left over, because fewer twins are there, go to those that are not.

    Args:
        poses: of the frame, by the name that the run gave them.
        truth: T_camera_part of the parts that are there.
        names: of the twins.
        model: of any of them.
        measured: takes the ADD(S) that had to be measured, by the names of the pose and of the truth.

    Returns:
        The poses by the name of the twin that they are given to; one for which none is left is absent.
    """
    said = [name for name in names if name in poses]
    # Dearer than all true twins together: one that is not there takes only what is left over.
    cost = np.full((len(said), len(names)), FAR * len(names))
    for i, name in enumerate(said):
        for j, other in enumerate(names):
            if other in truth:
                pair = (poses[name].T_camera_part, truth[other], model)
                error = FAR
                if add_s_at_least(*pair) < FAR:
                    error = add_s(*pair)
                    if measured is not None:
                        measured[name, other] = error
                cost[i, j] = min(error, FAR)
            cost[i, j] -= OWN_NAME * (name == other)
    return {names[j]: poses[said[i]] for i, j in cheapest_pairs(cost)}
