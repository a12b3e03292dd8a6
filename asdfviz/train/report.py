"""What a detector's run says now and then."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.train.presets import Ran
from asdfviz.train.validation import Validation


@dataclass(frozen=True, slots=True)
class TrainReport:
    """What the run says now and then to whoever watches it."""

    step: int
    share: float
    """Of the budget used, 0 to 1."""
    losses: dict[str, float]
    """Means since the last report."""
    inputs_per_s: float
    validation: Validation | None = None
    ran: Ran | None = None
    """Of its preset so far."""
