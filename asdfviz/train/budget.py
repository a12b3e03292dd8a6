"""What every training run does alike: it counts its budget over sittings, and descends."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor, nn

from asdfviz.errors import InputError
from asdfviz.train.checkpoint import Progress
from asdfviz.train.log import CsvLog

LOG_SECONDS = 20.0
"""Between two lines of a run's log."""


class Budget:
    """How much of a run's minutes or steps is used; earlier sittings count."""

    def __init__(self, *, minutes: float, steps: int | None) -> None:
        """Begin a sitting.

        Args:
            minutes: of wall clock in all.
            steps: counted instead, unless None.
        """
        self._minutes, self._steps = minutes, steps
        self._began = time.monotonic()
        self.before = 0.0
        """Seconds of earlier sittings."""

    @property
    def seconds(self) -> float:
        """Wall clock of the run, earlier sittings counted in."""
        return self.before + time.monotonic() - self._began

    def share(self, step: int) -> float:
        """Share that is used after so many steps, from 0; 1 and more is all of it."""
        if self._steps is not None:
            return step / max(self._steps, 1)
        return self.seconds / (self._minutes * 60)


class Alarm:
    """Rings when so many seconds of a run have passed since it rang last."""

    def __init__(self, every_s: float, *, now: float, first_s: float | None = None) -> None:
        """Begin to wait.

        Args:
            every_s: seconds between two rings.
            now: seconds of the run.
            first_s: seconds to the first ring; None: as between two.
        """
        self._every = every_s
        self._due = now + (every_s if first_s is None else first_s)

    def wait(self, now: float) -> None:
        """Ring so many seconds from `now` on: after what took long itself."""
        self._due = now + self._every

    def rings(self, now: float) -> bool:
        """Whether it is time, seconds of the run being `now`; waits anew from then on."""
        if now <= self._due:
            return False
        self.wait(now)
        return True


class Sitting:
    """What the sessions of all networks share: how far the run is, and the file that it goes on from."""

    def __init__(self, output: Path, *, minutes: float, steps: int | None) -> None:
        """Begin at the start of a run; its clock runs from here.

        Args:
            output: run folder.
            minutes: as for `Budget`.
            steps: as for `Budget`.
        """
        self.progress = Progress()
        self._budget = Budget(minutes=minutes, steps=steps)
        self._output = output

    @property
    def seconds(self) -> float:
        """Wall clock of the run, earlier sittings counted in."""
        return self._budget.seconds

    @property
    def share(self) -> float:
        """Share of the budget that is used."""
        return self._budget.share(self.progress.step)

    @property
    def last(self) -> Path:
        """The checkpoint that a later run goes on from."""
        return self._output / "last.pt"

    def csv_log(self, name: str, columns: Sequence[str]) -> CsvLog:
        """A log of this run; a run that goes on goes on in it."""
        return CsvLog(self._output / name, columns, step=self.progress.step)


def descend(
    total: Tensor,
    optimizer: torch.optim.Optimizer,
    parameters: Sequence[nn.Parameter],
    *,
    clip: float,
    step: int,
    share_gradients: Callable[[Sequence[nn.Parameter]], None] | None = None,
) -> None:
    """Take one step down a loss.

    Args:
        total: the loss.
        optimizer: of the parameters, with this step's learning rate.
        parameters: whose gradients are clipped together.
        clip: largest norm of all gradients.
        step: for the message.
        share_gradients: averages gradients over processes.

    Raises:
        InputError: the loss is not finite.
    """
    if not bool(torch.isfinite(total)):
        rate = float(optimizer.param_groups[0]["lr"])
        raise InputError(
            f"the loss is not finite at step {step}: lower the learning rate ({rate:g}) or switch "
            "bfloat16 off"
        )
    optimizer.zero_grad(set_to_none=True)
    total.backward()  # pyright: ignore[reportUnknownMemberType] - untyped in torch
    if share_gradients is not None:
        share_gradients(parameters)
    nn.utils.clip_grad_norm_(parameters, clip)
    optimizer.step()  # pyright: ignore[reportUnknownMemberType] - untyped in torch
