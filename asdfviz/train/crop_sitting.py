"""What both trainings on crops share: the loop over a pool that is renewed, and what is left when it ends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from asdfviz.train.budget import LOG_SECONDS, Alarm, Sitting
from asdfviz.train.crop_config import CropRunConfig
from asdfviz.train.crop_data import CropMaker
from asdfviz.train.crop_pool import CropPool, pools
from asdfviz.train.crop_scenes import CropConfig
from asdfviz.train.log import Meter

Config = TypeVar("Config", bound=CropRunConfig)
Report = TypeVar("Report")
"""What the run says now and then to whoever watches it."""
Found = TypeVar("Found")
"""What validation finds."""


class CropSitting(Sitting, ABC, Generic[Config, Report, Found]):
    """A run in progress."""

    config: Config
    maker: CropMaker
    rng: np.random.Generator

    def go(self, report: Callable[[Report], None], stop: Callable[[], bool]) -> bool:
        """Step until the budget is used (True) or `stop` says so (False), which leaves weights, too."""
        config, now = self.config, self.seconds
        log = Alarm(LOG_SECONDS, now=now)
        checkpoint = Alarm(config.checkpoint_minutes * 60, now=now)
        validate = Alarm(config.validate_minutes * 60, now=now)
        meter = Meter()
        for pool in pools(
            config,
            maker=self.maker,
            drawing=self.drawing,
            stop=stop,
            step=lambda: self.progress.step,
            rng=self.rng,
        ):
            if self.share >= 1 or stop():
                break
            self.step(pool, meter)
            if log.rings(self.seconds):
                report(self._logged(meter))
                meter = Meter()
            if checkpoint.rings(self.seconds):
                self.checkpoint()
            if self.share < 1 and validate.rings(self.seconds):
                report(self._report(meter, self.validate()))
                validate.wait(self.seconds)
        if meter.steps:
            report(self._logged(meter))
        self.checkpoint()
        finished = self.share >= 1
        if not finished and self.progress.best < 0:
            self._export_unjudged()
        return finished

    @property
    @abstractmethod
    def drawing(self) -> CropConfig:
        """What rendered crops show."""

    @abstractmethod
    def step(self, pool: CropPool, meter: Meter) -> None:
        """Take one optimiser step."""

    @abstractmethod
    def validate(self) -> tuple[Found, ...]:
        """Validate the averaged weights; keep and export them if they are the best so far."""

    @abstractmethod
    def checkpoint(self) -> None:
        """Write last.pt with all that is needed to go on."""

    @abstractmethod
    def _export_unjudged(self) -> None:
        """Export the averaged weights of a run that ends before any were judged."""

    @abstractmethod
    def _logged(self, meter: Meter) -> Report:
        """Write a line of the log, and the curve."""

    @abstractmethod
    def _report(self, meter: Meter, found: tuple[Found, ...] = ()) -> Report:
        """What the meter says, and validation."""
