"""One training run in progress: its network, optimiser, logs and checkpoints."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import cast

from torch import Tensor

from asdfviz.data.atomic import write_text
from asdfviz.datatypes import Assembly
from asdfviz.detector.joint import joint_classes
from asdfviz.detector.network import Network
from asdfviz.train.budget import LOG_SECONDS, Alarm, Sitting, descend
from asdfviz.train.checkpoint import (
    Average,
    Progress,
    about_run,
    averaged,
    begin_from,
    load_checkpoint,
    network_of,
    require_same,
    save_checkpoint,
    write_checkpoint,
)
from asdfviz.train.config import TrainConfig
from asdfviz.train.dataset import LabelledImage
from asdfviz.train.epochs import Epochs
from asdfviz.train.inputs import input_stream
from asdfviz.train.learner import batch_loss, new_learner
from asdfviz.train.loader import Batch, Recipe
from asdfviz.train.log import Meter, write_curve
from asdfviz.train.presets import Ran, what_ran
from asdfviz.train.report import TrainReport as TrainReport
from asdfviz.train.schedule import make_optimizer, rate_at, recipe_stage
from asdfviz.train.split import stored_pictures
from asdfviz.train.validation import LOGGED, SCORE, Validation, validate
from asdfviz.train.world import join_world

LOSS_NAMES = ("box", "keypoint", "visibility", "classes", "bins", "rotation")
LOG_COLUMNS = ("step", "minutes", "width", "rate", *LOSS_NAMES, "inputs_per_s", "objects")
FIRST_LOG_SECONDS = 2.0
"""The first line comes sooner: whoever waits for it wants to know whether it trains."""


class Session(Sitting):
    """The state of a run in progress; `train` drives it."""

    def __init__(self, config: TrainConfig, assemblies: Sequence[Assembly]) -> None:
        self.world = join_world(config.device)
        self.config, self.assemblies = config, tuple(assemblies)
        self.classes = joint_classes(self.assemblies)
        config.output.mkdir(parents=True, exist_ok=True)
        self.images, self.validation_images = stored_pictures(config, self.assemblies)
        self.epochs = Epochs(len(self.images), limit=config.epochs, patience=config.patience)
        self.network, self.hint = new_learner(
            config, classes=len(self.classes), device=self.world.device
        )
        self.optimizer = make_optimizer(
            (self.network, self.hint),
            learning_rate=config.learning_rate,
            weight_decay=config.weight_decay,
        )
        self.average = Average(self.network, decay=config.ema)
        super().__init__(config.output, minutes=config.minutes, steps=config.steps)
        self._warm_from = 0
        self._resume()
        self._agreed = self._used
        self.log = self.csv_log("log.csv", LOG_COLUMNS)
        columns = [f"{n}:{f}" for n in self.classes for f in LOGGED]
        self.validation_log = self.csv_log("validation.csv", ("step", "minutes", "score", *columns))
        text = json.dumps(dataclasses.asdict(config), indent=2, default=str)
        write_text(config.output / "config.json", text + "\n")

    @property
    def share(self) -> float:
        """Share of the budget that is used, as agreed at the last step."""
        return self._agreed

    @property
    def _used(self) -> float:
        return max(self._budget.share(self.progress.step), self.epochs.share)

    def go(self, report: Callable[[TrainReport], None], stop: Callable[[], bool]) -> bool:
        """Step until the budget is used (True) or `stop` says so (False)."""
        validated = self.seconds
        log = Alarm(LOG_SECONDS, now=validated, first_s=FIRST_LOG_SECONDS)
        checkpoint = Alarm(self.config.checkpoint_minutes * 60, now=validated)
        meter = Meter()
        world = self.world
        with input_stream(
            self.config,
            self.assemblies,
            self.images,
            world=world,
            recipe=self.recipe,
            first=self.progress.step,
        ) as stream:
            while self.share < 1:
                if world.agree(float(stop())):
                    self.checkpoint()
                    break
                self.step(stream, meter)
                self._agreed = world.agree(self._used)
                if not world.is_first:
                    continue
                if log.rings(self.seconds):
                    report(self.write_log(meter))
                    meter = Meter()
                if checkpoint.rings(self.seconds):
                    self.checkpoint()
                if self._is_due(self.seconds - validated) and self.share < 1:
                    best = self.progress.best
                    found = self.validate(self.config.validation_frames)
                    self.epochs.validated(is_best=self.progress.best > best)
                    report(
                        dataclasses.replace(self._report(meter), validation=found)
                    ) if meter.steps else None
                    validated = self.seconds
        if meter.steps and world.is_first:
            report(self.write_log(meter))
        return self.share >= 1

    def _is_due(self, waited_s: float) -> bool:
        """Whether to validate now: where epochs are counted, after each."""
        if self.config.epochs is not None:
            return bool(self.validation_images) and self.epochs.is_due
        return waited_s > self.config.validate_minutes * 60

    def recipe(self, step: int) -> Recipe:
        """What the batch of a step is made of."""
        steps = self.config.steps
        share = self.share if steps is None else step / max(steps, 1)
        spread = min(1.0, 0.3 + 0.7 * share / max(self.config.calm_share, 1e-9))
        return Recipe(stage=recipe_stage(self.config, share), spread=spread)

    def step(self, stream: Iterator[Batch], meter: Meter) -> None:
        """Take one optimiser step."""
        config = self.config
        batch = next(stream).to(self.world.device)
        rate = rate_at(config, self.progress.step - self._warm_from, min(self.share, 1.0))
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.network.train()
        total, losses = batch_loss(self.network, self.hint, batch, config)
        descend(
            total,
            self.optimizer,
            [*self.network.parameters(), *self.hint.parameters()],
            clip=config.clip,
            step=self.progress.step,
            share_gradients=self.world.average_gradients,
        )
        self.average.update(self.network)
        self.progress.step += 1
        self.epochs.draw(len(batch.images) * self.world.size)
        objects = int(batch.targets.present.sum())
        meter.add(losses, len(batch.images), objects)

    def write_log(self, meter: Meter) -> TrainReport:
        """Append to the log and draw the curve."""
        report = self._report(meter)
        self.log.add(
            {
                "step": float(self.progress.step),
                "minutes": self.seconds / 60,
                "width": float(self.recipe(self.progress.step).stage.width),
                "rate": self.optimizer.param_groups[0]["lr"],
                "inputs_per_s": report.inputs_per_s,
                "objects": meter.objects / max(meter.inputs, 1),
                **report.losses,
            }
        )
        note = report.ran.text() if report.ran else ""
        curve = self.config.output / "curve.png"
        write_curve(curve, self.log, x="minutes", curves=LOSS_NAMES, note=note)
        return report

    def ran(self, *, finished: bool | None) -> Ran | None:
        """What of its preset the run did; as for `what_ran`."""
        shown = [image.assembly for image in (*self.images, *self.validation_images)]
        return what_ran(self.config, shown, self.epochs, finished=finished)

    def validate(self, frames: int | None) -> Validation | None:
        """Validate the averaged weights and keep them if they are the best so far."""
        images = self._spread(frames)
        if not images:
            return None
        found = self._judged(averaged(self.network, self.average), images)
        when = {"step": float(self.progress.step), "minutes": self.seconds / 60}
        self.validation_log.add({**when, "score": found.score, **found.columns()})
        if found.score > self.progress.best:
            self.progress.best = found.score
            self.checkpoint(path=self.config.output / "best.pt", whole=False)
            self._note(found)
        return found

    def _spread(self, frames: int | None) -> tuple[LabelledImage, ...]:
        """About so many of the validation pictures, always the same; None for all."""
        images = self.validation_images
        return images if frames is None else images[:: max(1, len(images) // frames)]

    def _judged(self, network: Network, images: Sequence[LabelledImage]) -> Validation:
        size, device = self.config.image_size, self.world.device
        return validate(network.to(device), images, self.assemblies, image_size=size, device=device)

    def _note(self, found: Validation) -> None:
        write_text(self.config.output / "validation.json", json.dumps(found.as_json(), indent=2))

    def _rejudge_best(self, best: Path, frames: int | None) -> None:
        """Score the best weights so far on these frames: only scores of the same compare."""
        content = load_checkpoint(best)
        found = self._judged(network_of(content), self._spread(frames))
        self.progress.best = found.score
        progress = [*content["progress"][:2], found.score]
        write_checkpoint(best, {**content, "progress": progress, "score": SCORE})
        self._note(found)

    def finish(self) -> Validation | None:
        """Checkpoint and validate on all frames; without validation the last weights are best."""
        if not self.world.is_first:
            return None
        self.checkpoint()
        best = self.config.output / "best.pt"
        if self.validation_images and self.progress.best >= 0 and best.is_file():
            self._rejudge_best(best, None)
        found = self.validate(None)
        if found is None or not best.is_file():
            self.checkpoint(path=best, whole=False)
        return found

    def checkpoint(self, *, path: Path | None = None, whole: bool = True) -> None:
        """Write last.pt, or another file; `whole` with all that is needed to go on."""
        if not self.world.is_first:
            return
        self.progress.seconds = self.seconds
        trainer = {
            "optimizer": self.optimizer.state_dict(),
            "hint": self.hint.state_dict(),
            "warm_from": self._warm_from,
        }
        save_checkpoint(
            path or self.last,
            network=self.network,
            average=self.average,
            progress=self.progress,
            about=about_run(self.config, self.assemblies),
            drawn={"split": self.config.split, "epochs": self.epochs.state()},
            trainer=trainer if whole else None,
        )

    def _resume(self) -> None:
        if not (self.config.resume and self.last.is_file()):
            if self.config.start is not None:
                begin_from(self.network, self.config.start, classes=self.classes)
                self.average.state = {k: v.clone() for k, v in self.network.state_dict().items()}
            return
        content = load_checkpoint(self.last)
        require_same(
            content,
            self.last,
            network=self.network,
            classes=self.classes,
            image_size=self.config.image_size,
            split=self.config.split,
        )
        average = cast(dict[str, Tensor], content["average"])
        self.network.load_state_dict(content["network"] or average)
        self.average.state = {k: v.to(self.world.device) for k, v in average.items()}
        self.average.updates = content["updates"]
        step, seconds, best = content["progress"]
        self.progress = Progress(step=step, seconds=seconds, best=best)
        self._budget.before = seconds
        self.epochs.load(content.get("drawn", {}).get("epochs", {}))
        if content["trainer"]:
            self.optimizer.load_state_dict(content["trainer"]["optimizer"])
            self.hint.load_state_dict(content["trainer"]["hint"])
            self._warm_from = content["trainer"].get("warm_from", 0)  # older ones lack it
        else:
            self._warm_from = step
        if content.get("score") != SCORE and best >= 0:
            self.progress.best = -1.0
            file = self.config.output / "best.pt"
            if self.world.is_first and self.validation_images and file.is_file():
                self._rejudge_best(file, self.config.validation_frames)

    def _report(self, meter: Meter) -> TrainReport:
        return TrainReport(
            step=self.progress.step,
            share=min(self.share, 1.0),
            losses=dict(zip(LOSS_NAMES, meter.means(), strict=True)),
            inputs_per_s=meter.inputs_per_s,
            ran=self.ran(finished=None),
        )
