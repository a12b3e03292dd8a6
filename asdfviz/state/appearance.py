"""The network's term S_DL of Pose2State: what the state boxes say.

The paper takes the highest-scoring state class. Readings of what it leaves open:

- From scores to probabilities: a softmax over each state's best box score, with a temperature.
- State 0 has no class in the authors' files, since it looks like the base part alone. Every correct
  state without a class gets what the boxes leave: `absence` * (1 - best state score). A box that is
  missing says less than a box that is there, hence the factor.
- An error state without a class looks most like the state it follows and gets that one's score, so
  that appearance does not decide between the two.
- No state classes at all, or neither a state box nor the base part in the picture: no evidence, None.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, Detection
from asdfviz.geometry.shapes import Scores


@dataclass(frozen=True)
class AppearanceConfig:
    """How box scores and crops become probabilities; the paper gives no numbers."""

    temperature: float = 0.2
    """Softmax temperature, in units of the box score: 0.2 makes 0.9 against 0 a ratio of 90."""
    absence: float = 0.2
    """Score of a state without a class where no state box is found, 0 to 1."""
    error_odds: float = 0.3
    """Crops: how much likelier each error is than a correct state before anything is seen. Training
    shows all states alike often; people make fewer mistakes."""


def appearance_probabilities(
    detections: Sequence[Detection], assembly: Assembly, *, config: AppearanceConfig
) -> Scores | None:
    """Return the probability of every state by its looks, or None where nothing speaks.

    Args:
        detections: all boxes of the frame; those of parts only show whether the base is in view.
        assembly: its states name their detector classes.
        config: temperature and the weight of absence.
    """
    if all(state.detector_class is None for state in assembly.states):
        return None
    best: dict[str, float] = {}
    for detection in detections:
        best[detection.label] = max(detection.score, best.get(detection.label, 0.0))
    boxes = [best.get(s.detector_class or "", 0.0) for s in assembly.states]
    highest = max(boxes)
    if highest <= 0 and assembly.parts[assembly.base].detector_class not in best:
        return None
    scores = np.array(boxes)
    without_class = config.absence * (1.0 - highest)
    for state in assembly.steps:
        if state.detector_class is None:
            scores[state.index] = without_class
    for state in assembly.errors:
        if state.detector_class is None:
            scores[state.index] = scores[state.completed]
    odds = np.exp((scores - scores.max()) / config.temperature)
    return odds / odds.sum()
