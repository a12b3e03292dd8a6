"""The states of a run decoded offline (`asdfviz.state.decoding`), for figures apart from those online.

A run of `asdf_plus` or `asdf_track` is decoded by the hidden Markov model that followed it, with the run's own options. One
of Pose2State (`asdf`) has no such model: its two terms are decoded by that of the others, as
`asdfviz ablate fusion` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, cast

import numpy as np

from asdfviz.datatypes import Assembly, FramePrediction, Run, StateEstimate
from asdfviz.errors import MethodError
from asdfviz.state.half_done import HalfDone
from asdfviz.state.offline import FollowedTerms
from asdfviz.state.smoothing import FOLLOWED, SmoothingConfig

OFFLINE = "state_offline"
"""Key of a report: figures as under "state", of states decoded with the whole recording known."""


def offline_predictions(run: Run, assembly: Assembly) -> dict[int, FramePrediction] | None:
    """The run's frames with the states decoded from all of them; these say nothing of how sure they are.

    Returns:
        By frame number; None where the run does not keep all terms of its states, or where its own
        states do not come out of them, as when a version before followed otherwise.
    """
    followed = _followed(run, assembly)
    if followed is None:
        return None
    states = np.eye(len(assembly.states))
    return {
        prediction.frame_index: replace(prediction, state=StateEstimate(states[index]))
        for prediction, index in zip(run.predictions, followed.offline(), strict=True)
    }


def _followed(run: Run, assembly: Assembly) -> FollowedTerms | None:
    said = [prediction.state for prediction in run.predictions]
    told = run.config.get("smoothing")
    if told is None:
        ways = HalfDone.none(assembly)
        fuses = "fusion" in run.config
        return FollowedTerms.of(said, ways, config=FOLLOWED) if fuses else None
    config = _smoothing(told)
    if config is None:
        return None
    ways = HalfDone.of(assembly) if _has_half_done(run.config) else HalfDone.none(assembly)
    terms = FollowedTerms.of(said, ways, config=config)
    return terms if terms is not None and terms.gave(said) else None


def _smoothing(told: object) -> SmoothingConfig | None:
    """The model as the run's options have it; None where these are not those of this version."""
    if not isinstance(told, Mapping):
        return None
    try:
        return SmoothingConfig(**cast(Mapping[str, Any], told))
    except (TypeError, MethodError):
        return None


def _has_half_done(config: Mapping[str, object]) -> bool:
    """Whether half-done steps were states of the model, as `FollowedState` has it."""
    options = config.get("relative_pose")
    share = (
        cast(Mapping[str, object], options).get("half_done") if isinstance(options, Mapping) else 0
    )
    return isinstance(share, int | float) and share > 0
