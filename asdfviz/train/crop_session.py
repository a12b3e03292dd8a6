"""One training run of the crop network: `train_crops(config)` runs a budget and leaves a run folder.

The folder holds last.pt (goes on where it was), crops.safetensors and .json (the best weights, kept
up to date; those of a run that was stopped before any were judged), log.csv, validation.csv, validation.json and curve.png; pool/ holds the
crops, where processes make them, and validation/ those that are judged on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from asdfviz.data.assembly import load_assembly
from asdfviz.detector.crop_classes import group_states
from asdfviz.detector.crop_network import CropNetwork
from asdfviz.detector.crop_weights import network_of_shape
from asdfviz.detector.precision import has_bfloat16
from asdfviz.train.budget import descend
from asdfviz.train.checkpoint import Average
from asdfviz.train.crop_checkpoint import (
    begin_crops_from,
    export,
    resume_crops,
    save_crop_checkpoint,
)
from asdfviz.train.crop_config import CropTrainConfig, check_crop_config
from asdfviz.train.crop_data import CropMaker
from asdfviz.train.crop_found import found_crops, mixed
from asdfviz.train.crop_losses import LOSSES, crop_losses, misnamed
from asdfviz.train.crop_pool import CropPool
from asdfviz.train.crop_scenes import CropConfig
from asdfviz.train.crop_sitting import CropSitting
from asdfviz.train.crop_validation import CropValidation, validate_crops
from asdfviz.train.crop_validation_sets import validation_sets
from asdfviz.train.crop_views import ViewMaker, Views
from asdfviz.train.log import Meter, write_curve
from asdfviz.train.schedule import make_optimizer, rate_at

DRAWN = {
    "all": CropConfig(),
    "names": CropConfig(groups=0.0),  # crops of groups say nothing of names
    "poses": CropConfig(nothing=0.0),  # what is no part has none
}
"""What crops show, by what is taught."""
FIGURES = ("found1", "found5", "found20", "best_deg", "mean_deg", "state", "name")


@dataclass(frozen=True, slots=True)
class CropReport:
    """What the run says now and then to whoever watches it."""

    step: int
    share: float
    """Of the budget used, 0 to 1."""
    losses: dict[str, float]
    crops_per_s: float
    validation: tuple[CropValidation, ...] = ()


class CropSession(CropSitting[CropTrainConfig, CropReport, CropValidation]):
    """The state of a run in progress."""

    def __init__(self, config: CropTrainConfig) -> None:
        check_crop_config(config)
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)  # pyright: ignore[reportUnknownMemberType] - untyped in torch
        config.output.mkdir(parents=True, exist_ok=True)
        self.config = config
        self.assemblies = [load_assembly(name) for name in config.assemblies]
        self._names_only = config.teach == "names"
        self.maker = CropMaker(self.assemblies, config=self.drawing, device=config.device)
        self.classes = self.maker.classes
        self.found = (
            found_crops(config.scenes, self.assemblies, self.classes) if config.scenes else None
        )
        self.names = [c.name for c in self.classes]
        self.states = group_states(self.classes)
        self.views = ViewMaker(self.classes, grid=config.grid, device=config.device)
        count = sum(len(states) for states in self.states.values())
        network = CropNetwork(classes=len(self.classes), grid=config.grid, states=count, names=True)
        network.to(config.device)
        self.network = network
        self.network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
        self.taught = _taught(network, config.teach)
        self.optimizer = make_optimizer(
            self.taught, learning_rate=config.learning_rate, weight_decay=config.weight_decay
        )
        self.average = Average(network, decay=config.ema)
        super().__init__(config.output, minutes=config.minutes, steps=config.steps)
        if config.start is not None:
            begin_crops_from(network, config.start, names=self.names, states=self.states)
            self.average.state = {k: v.clone() for k, v in network.state_dict().items()}
        self._resume()
        self.log = self.csv_log("log.csv", ("step", "minutes", "rate", "crops_per_s", *LOSSES))
        self.rng = np.random.default_rng([config.seed, self.progress.step])
        self.validation_sets = validation_sets(config, self.maker, self.views, self.assemblies)
        columns = [f"{name}:{figure}" for name in self.validation_sets for figure in FIGURES]
        self.validation_log = self.csv_log("validation.csv", ("step", "minutes", "score", *columns))

    @property
    def drawing(self) -> CropConfig:
        """What rendered crops show."""
        return DRAWN[self.config.teach]

    def step(self, pool: CropPool, meter: Meter) -> None:
        """Take one optimiser step."""
        config = self.config
        for group in self.optimizer.param_groups:
            group["lr"] = rate_at(config, self.progress.step, self.share)
        with torch.no_grad():
            crops = mixed(pool, self.found, maker=self.maker, config=config, rng=self.rng)
            batch = self.views.views(crops, rng=self.rng)
        losses = self._losses(batch)
        gains = losses.new_tensor(
            [
                1.0,
                config.place_gain,
                config.outline_gain,
                config.state_gain,
                config.name_gain,
            ]
        )
        total = (losses * gains).sum()
        descend(
            total,
            self.optimizer,
            [p for module in self.taught for p in module.parameters()],
            clip=config.clip,
            step=self.progress.step,
        )
        self.average.update(self.network)
        self.progress.step += 1
        meter.add(losses.detach(), len(batch.labels), len(batch.labels))

    def _losses(self, batch: Views) -> Tensor:
        config = self.config
        self.network.eval()
        for module in self.taught:
            module.train()
        half = config.bfloat16 and has_bfloat16(config.device)
        pictures = batch.pictures.contiguous(memory_format=torch.channels_last)
        with torch.autocast(torch.device(config.device).type, torch.bfloat16, enabled=half):
            if config.teach == "poses":
                names = pictures.new_zeros(len(pictures), 0)
            else:
                names = self.network.names(pictures, batch.sizes)
            if self._names_only:
                missed = misnamed(names, batch)
                return torch.stack([torch.zeros_like(missed)] * (len(LOSSES) - 1) + [missed])
            out = self.network(pictures, batch.labels)
        with torch.no_grad():
            target = self.views.targets(batch.quaternions, batch.labels)
        return crop_losses(out, names, batch, target=target, views=self.views)

    def validate(self) -> tuple[CropValidation, ...]:
        """Validate the averaged weights; keep and export them if they are the best so far."""
        config = self.config
        network = self._averaged()
        found = tuple(
            validate_crops(network, sets, self.views, self.classes, name=name)
            for name, sets in self.validation_sets.items()
        )
        values = {"step": float(self.progress.step), "minutes": self.seconds / 60}
        for one in found:
            rows = np.array([[*c.found, c.best_deg, c.mean_deg] for c in one.classes])
            figures = (*rows.mean(axis=0), one.state, one.name_right)
            values |= {f"{one.name}:{f}": float(v) for f, v in zip(FIGURES, figures, strict=True)}
        # Parts in scenes are what counts; without any, crops of the training's own kind.
        told = (found[-1].score, found[0].state, found[-1].name_right)
        told = {"all": told, "names": told[2:], "poses": told[:2]}[config.teach]
        told = [v for v in told if math.isfinite(v)]
        values["score"] = score = sum(told) / max(len(told), 1)
        self.validation_log.add(values)
        shown = [f"{one.name}:{figure}" for one in found for figure in ("found1", "found20")]
        shown += [f"{found[0].name}:state", f"{found[-1].name}:name"]
        path = config.output / "validation.png"
        write_curve(path, self.validation_log, x="minutes", curves=shown)
        if score > self.progress.best:
            self.progress.best = score
            self._export(network, found)
        return found

    def _export_unjudged(self) -> None:
        self._export(self._averaged(), ())

    def _averaged(self) -> CropNetwork:
        network = network_of_shape(self.network.shape).to(self.config.device)
        network.load_state_dict(self.average.state)
        return network.eval()

    def _export(self, network: CropNetwork, found: tuple[CropValidation, ...]) -> None:
        self.progress.seconds = self.seconds
        names, states = self.names, self.states
        export(self.config, network, self.progress, names=names, states=states, found=found)

    def checkpoint(self) -> None:
        """Write last.pt with all that is needed to go on."""
        self.progress.seconds = self.seconds
        save_crop_checkpoint(
            self.last,
            network=self.network,
            average=self.average,
            progress=self.progress,
            optimizer=self.optimizer,
            about=self._about(),
        )

    def _resume(self) -> None:
        if not self.last.is_file():
            return
        self.progress = resume_crops(
            self.last,
            network=self.network,
            average=self.average,
            optimizer=self.optimizer,
            about=self._about(),
        )
        self._budget.before = self.progress.seconds

    def _about(self) -> dict[str, object]:
        return {"classes": self.names, "states": self.states, "shape": self.network.shape}

    def _logged(self, meter: Meter) -> CropReport:
        report = self._report(meter)
        values = {"step": float(self.progress.step), "minutes": self.seconds / 60}
        values |= {"rate": self.optimizer.param_groups[0]["lr"], "crops_per_s": report.crops_per_s}
        self.log.add({**values, **report.losses})
        write_curve(self.config.output / "curve.png", self.log, x="minutes", curves=LOSSES)
        return report

    def _report(self, meter: Meter, found: tuple[CropValidation, ...] = ()) -> CropReport:
        losses: dict[str, float] = dict(zip(LOSSES, meter.means(), strict=False))
        share = min(self.share, 1.0)
        return CropReport(self.progress.step, share, losses, meter.inputs_per_s, found)


def _taught(network: CropNetwork, teach: str) -> tuple[nn.Module, ...]:
    if teach == "all" or network.name is None:
        return (network,)
    if teach == "names":
        return (network.name,)
    return tuple(module for module in network.children() if module is not network.name)
