"""What `--published` means for the paper's methods: its steps to the letter, and none of ours.

Schieber et al., ISMAR 2024: the best boxes of each class, their keypoints, RANSAC PnP at 12 px, one
translation step of section 3.1.1, state boxes, and Pose2State of equations 3 to 5. Nothing gates,
repairs or replaces what a step gives. What the paper leaves open stays as it is configured: the network,
W(d) and its scale, which points are nearest, which of like parts is which, how boxes become S_DL and
relative poses S_P, the weights of the equations, and the limits of ICP.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from asdfviz.errors import MethodError

FAR = 1e3
"""Beyond any part and any shift, metres: a limit that limits nothing."""
STEPS: Mapping[str, object] = {
    "detector.confidence": 0.3,
    "first_pose": "keypoints",
    "pnp.solver": "ransac",
    "pnp.reprojection_px": 12.0,
    "pnp.reprojection_share": 0.0,
    "pnp.smallest_px": 0.0,
    "pnp.min_inliers": 1,
    "pnp.min_spread": 0.0,
    "pnp.nearest": 0.0,
    "pnp.farthest": FAR,
    "translation.enabled": True,
    "translation.coarse": False,
    "translation.steps": 1,
    "translation.max_shift": FAR,
    "translation.edge": FAR,
    "translation.min_points": 1,
    "translation.min_agreement": 0.0,
    "second_look.enabled": False,
    "names.enabled": False,
    "names.strangers.enabled": False,
    "state_looks": "boxes",
}
"""Options of all the paper's methods, by their names."""
FUSED_STEPS: Mapping[str, object] = {
    **STEPS,
    "box_fit.enabled": False,
    "contests.enabled": False,
    "rivals.count": 0,
    "rivals.depth_check.enabled": False,
    "unlike_twins.enabled": False,
    "place_looks.enabled": False,
    "base_votes.enabled": False,
    "relative_pose.half_done": 0.0,
    "lately_loose.enabled": False,
    "fusion.sharpness": 1.0,
    "fusion.errors_wait": False,
    "group.enabled": False,
    "first_confidence.enabled": False,
    "least_score": 0.0,
}
"""And of those that fuse states."""


def publish(config: Any, steps: Mapping[str, object]) -> None:
    """Set the options of a config that is being made as the paper has them.

    Args:
        config: a frozen dataclass; changed in place.
        steps: values by option.

    Raises:
        MethodError: an option was given that the paper contradicts.
    """
    usual = type(config)()
    for option, value in steps.items():
        name, _, inner = option.partition(".")
        own = _changed(getattr(config, name), getattr(usual, name), inner, value, option=option)
        object.__setattr__(config, name, own)


def _changed(given: Any, usual: Any, path: str, value: object, *, option: str) -> Any:
    """What is given, with the value at a path in it; refused where neither it nor the default is there."""
    if not path:
        if given not in (usual, value):
            raise MethodError(
                f"{option} is {given}, but published is {value}: leave out the one or the other"
            )
        return value
    name, _, inner = path.partition(".")
    own = _changed(getattr(given, name), getattr(usual, name), inner, value, option=option)
    return replace(given, **{name: own})
