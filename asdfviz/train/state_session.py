"""One training run of the state network: `StateSession(config).go(...)` runs a budget and leaves a run folder.

The folder holds last.pt (goes on where it was), states.safetensors and .json (the best weights, kept up to
date), log.csv, validation.csv and curve.png; pool/ holds the crops, where processes make them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.detector.crop_classes import group_states
from asdfviz.detector.crop_maps import MAPS
from asdfviz.detector.precision import has_bfloat16
from asdfviz.detector.state_network import StateNetwork
from asdfviz.detector.state_weights import state_network_of_shape
from asdfviz.errors import WeightsError
from asdfviz.synth.tensors import to_tensor
from asdfviz.train.budget import descend
from asdfviz.train.checkpoint import Average, load_checkpoint, write_checkpoint
from asdfviz.train.crop_config import check_run
from asdfviz.train.crop_data import CropMaker, Crops
from asdfviz.train.crop_found import found_crops
from asdfviz.train.crop_pool import CropPool
from asdfviz.train.crop_scenes import CropConfig
from asdfviz.train.crop_sitting import CropSitting
from asdfviz.train.log import Meter, write_curve
from asdfviz.train.schedule import rate_at
from asdfviz.train.state_checkpoint import begin_states_from, export_states
from asdfviz.train.state_config import StateTrainConfig
from asdfviz.train.state_losses import smoothed_entropy
from asdfviz.train.state_validation import (
    StateValidation,
    state_validation_sets,
    validate_states,
)
from asdfviz.train.state_views import (
    STORED_STATE_PIXELS,
    StateViewMaker,
    StateViews,
)
from asdfviz.train.whole_run import resume_whole, whole_run

DRAWN = CropConfig(pixels=STORED_STATE_PIXELS, groups=1.0, half_done=0.5, hand=0.4)
"""What rendered crops show."""


@dataclass(frozen=True, slots=True)
class StateReport:
    """What the run says now and then to whoever watches it."""

    step: int
    share: float
    """Of the budget used, 0 to 1."""
    losses: dict[str, float]
    crops_per_s: float
    validation: tuple[StateValidation, ...] = ()


class StateSession(CropSitting[StateTrainConfig, StateReport, StateValidation]):
    """The state of a run in progress."""

    def __init__(self, config: StateTrainConfig) -> None:
        check_run(config)
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)  # pyright: ignore[reportUnknownMemberType] - untyped in torch
        config.output.mkdir(parents=True, exist_ok=True)
        self.config = config
        assemblies = [load_assembly(name) for name in config.assemblies]
        self.maker = CropMaker(assemblies, config=DRAWN, device=config.device)
        classes = self.maker.classes
        self.states = group_states(classes)
        self.views = StateViewMaker(assemblies, classes, device=config.device)
        self.found = self._found(assemblies)
        self.network = StateNetwork(
            points=self.views.points,
            normals=self.views.normals,
            axes=self.views.axes,
            states=sum(len(states) for states in self.states.values()),
        ).to(config.device)
        self.network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
        self.optimizer = self._optimizer()
        if config.start is not None:
            begin_states_from(self.network, config.start, states=self.states)
        self.average = Average(self.network, decay=config.ema)
        super().__init__(config.output, minutes=config.minutes, steps=config.steps)
        self._resume()
        self.log = self.csv_log("log.csv", ("step", "minutes", "rate", "crops_per_s", "state"))
        self.rng = np.random.default_rng([config.seed, self.progress.step])
        self.sets = state_validation_sets(config, self.maker, self.views, assemblies)
        columns = [f"{name}:{f}" for name in self.sets for f in ("right", "surprise")]
        self.validation_log = self.csv_log("validation.csv", ("step", "minutes", "score", *columns))

    @property
    def drawing(self) -> CropConfig:
        """What rendered crops show."""
        return DRAWN

    def step(self, pool: CropPool, meter: Meter) -> None:
        """Take one optimiser step."""
        config = self.config
        rate = rate_at(config, self.progress.step, self.share)
        for group in self.optimizer.param_groups:
            group["lr"] = rate * group["share"]
        with torch.no_grad():
            batch = self.views.views(self._drawn(pool), rng=self.rng)
        loss = self._loss(batch)
        descend(
            loss,
            self.optimizer,
            list(self.network.parameters()),
            clip=config.clip,
            step=self.progress.step,
        )
        self.average.update(self.network)
        self.progress.step += 1
        meter.add(loss.detach()[None], len(batch.states), len(batch.states))

    def _drawn(self, pool: CropPool) -> Crops:
        """The crops of a step: rendered ones, and some cut out of scenes if there are any."""
        config = self.config
        if self.found is None:
            return pool.draw(config.batch, rng=self.rng)
        count = round(config.scene_share * config.batch)
        rows = to_tensor(self.rng.integers(len(self.found), size=count), config.device)
        rendered = pool.draw(config.batch - count, rng=self.rng)
        return Crops.joined([rendered, self.found.taken(rows)])

    def _loss(self, batch: StateViews) -> Tensor:
        config = self.config
        self.network.train()
        half = config.bfloat16 and has_bfloat16(config.device)
        pictures = batch.pictures.contiguous(memory_format=torch.channels_last)
        with torch.autocast(torch.device(config.device).type, torch.bfloat16, enabled=half):
            logits = self.network(pictures, batch.groups, batch.poses, batch.focal)
        return smoothed_entropy(
            self.views.own_states(logits.float(), batch.groups),
            batch.states,
            smoothing=config.smoothing,
        )

    def validate(self) -> tuple[StateValidation, ...]:
        """Validate the averaged weights; keep and export them if they are the best so far."""
        network = self._averaged()
        found = tuple(
            validate_states(network, batches, self.views, list(self.states), name=name)
            for name, batches in self.sets.items()
        )
        values = {"step": float(self.progress.step), "minutes": self.seconds / 60}
        for one in found:
            values |= {f"{one.name}:right": one.mean, f"{one.name}:surprise": one.surprise}
        # How probable the truth was: few crops would pick by chance if only right and wrong counted.
        values["score"] = sum(math.exp(-one.surprise) for one in found) / len(found)
        self.validation_log.add(values)
        path = self.config.output / "validation.png"
        shown = [f"{one.name}:right" for one in found]
        write_curve(path, self.validation_log, x="minutes", curves=shown)
        if values["score"] > self.progress.best:
            self.progress.best = values["score"]
            self._export(network, found)
        return found

    def _found(self, assemblies: Sequence[Assembly]) -> Crops | None:
        if not self.config.scenes:
            return None
        found = found_crops(
            self.config.scenes,
            assemblies,
            self.maker.classes,
            pixels=STORED_STATE_PIXELS,
            only_groups=True,
        )
        return found.crops.to(self.config.device)

    def _optimizer(self) -> torch.optim.AdamW:
        """What the crop network has learned moves more slowly; biases and norms do not decay."""
        config = self.config
        groups: dict[tuple[bool, bool], list[torch.nn.Parameter]] = {}
        for name, parameter in self.network.named_parameters():
            key = (name.split(".")[0] in MAPS, parameter.ndim > 1)
            groups.setdefault(key, []).append(parameter)
        settings = [
            {
                "params": parameters,
                "share": config.maps_rate if is_map and config.start is not None else 1.0,
                "weight_decay": config.weight_decay if decays else 0.0,
            }
            for (is_map, decays), parameters in groups.items()
        ]
        return torch.optim.AdamW(settings, lr=config.learning_rate, betas=(0.9, 0.99))

    def _export_unjudged(self) -> None:
        self._export(self._averaged(), ())

    def _averaged(self) -> StateNetwork:
        network = state_network_of_shape(self.network.shape).to(self.config.device)
        network.load_state_dict(self.average.state)
        return network.eval()

    def _export(self, network: StateNetwork, found: tuple[StateValidation, ...]) -> None:
        self.progress.seconds = self.seconds
        export_states(self.config, network, self.progress, states=self.states, found=found)

    def checkpoint(self) -> None:
        """Write last.pt with all that is needed to go on."""
        self.progress.seconds = self.seconds
        content = whole_run(
            self.network,
            average=self.average,
            progress=self.progress,
            optimizer=self.optimizer,
            about=json.dumps(self._about()),
        )
        write_checkpoint(self.last, content)

    def _resume(self) -> None:
        if not self.last.is_file():
            return
        content = load_checkpoint(self.last)
        if json.loads(content["about"]) != json.loads(json.dumps(self._about())):
            raise WeightsError(
                f"'{self.last}' was trained for {content['about']}, asked for was "
                f"{json.dumps(self._about())}: take another run folder"
            )
        self.progress = resume_whole(
            content, self.network, average=self.average, optimizer=self.optimizer
        )
        self._budget.before = self.progress.seconds

    def _about(self) -> dict[str, object]:
        return {"states": self.states, "shape": self.network.shape}

    def _logged(self, meter: Meter) -> StateReport:
        report = self._report(meter)
        values = {"step": float(self.progress.step), "minutes": self.seconds / 60}
        rate = self.optimizer.param_groups[-1]["lr"]
        values |= {"rate": rate, "crops_per_s": report.crops_per_s}
        self.log.add(values | report.losses)
        write_curve(self.config.output / "curve.png", self.log, x="minutes", curves=("state",))
        return report

    def _report(self, meter: Meter, found: tuple[StateValidation, ...] = ()) -> StateReport:
        losses: dict[str, float] = dict(zip(("state",), meter.means(), strict=False))
        share = min(self.share, 1.0)
        return StateReport(self.progress.step, share, losses, meter.inputs_per_s, found)
