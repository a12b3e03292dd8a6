"""Passes over the training pictures: how many were made, and since when nothing became better."""

from __future__ import annotations

from collections.abc import Mapping


class Epochs:
    """Counts a run's inputs in epochs, and says when it is to stop early."""

    def __init__(self, pictures: int, *, limit: int | None, patience: int) -> None:
        """Begin at the start of a run.

        Args:
            pictures: that are trained on; so many inputs are an epoch.
            limit: epochs of the whole run; None for a run that is not counted in them.
            patience: epochs without a better validation after which the run stops.
        """
        self.limit = limit
        self._pictures, self._patience = max(pictures, 1), patience
        self._inputs = self._validated = self._best = 0

    @property
    def done(self) -> float:
        """Epochs so far."""
        return self._inputs / self._pictures

    @property
    def is_stale(self) -> bool:
        """Whether the last validation came `patience` epochs or more after the best one."""
        waited = self._validated - self._best
        return self.limit is not None and waited >= self._patience * self._pictures

    @property
    def is_due(self) -> bool:
        """Whether an epoch has ended since the last validation."""
        return self._inputs // self._pictures > self._validated // self._pictures

    @property
    def share(self) -> float:
        """Share of the limit that is used, from 0; 1 and more where the run is over."""
        if self.limit is None:
            return 0.0
        return 1.0 if self.is_stale else self.done / self.limit

    def draw(self, inputs: int) -> None:
        """Count the inputs of a step, those of all processes."""
        self._inputs += inputs

    def validated(self, *, is_best: bool) -> None:
        """Remember that a validation was made here."""
        self._validated = self._inputs
        if is_best:
            self._best = self._inputs

    def state(self) -> dict[str, int]:
        """What a checkpoint keeps, to go on exactly."""
        return {"inputs": self._inputs, "validated": self._validated, "best": self._best}

    def load(self, state: Mapping[str, int]) -> None:
        """Go on from `state`; nothing of an older checkpoint, which lacks it, was counted."""
        self._inputs = state.get("inputs", 0)
        self._validated, self._best = state.get("validated", 0), state.get("best", 0)
