"""One training run of a mask branch: `MaskSession(config).go()` runs a budget and leaves a run folder.

The detector is frozen: it computes the features and says, by its own assigner, which anchors learn
which object. The folder holds last.pt (goes on where it was), masks.safetensors and .json (also of a
run that was stopped), log.csv and curve.png.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.detector.assigner import AssignerConfig, assign
from asdfviz.detector.detector import Detector, DetectorConfig
from asdfviz.detector.head import decode_boxes
from asdfviz.detector.joint import SEPARATOR, joint_classes
from asdfviz.detector.mask_branch import MaskBranch
from asdfviz.detector.mask_weights import read_branch
from asdfviz.detector.precision import has_bfloat16
from asdfviz.detector.weights import load_network
from asdfviz.errors import WeightsError
from asdfviz.train.budget import LOG_SECONDS, Alarm, Sitting, descend
from asdfviz.train.checkpoint import Average
from asdfviz.train.log import Meter, write_curve
from asdfviz.train.mask_checkpoint import export_masks, resume_masks, save_mask_checkpoint
from asdfviz.train.mask_config import MaskTrainConfig, check_mask_config
from asdfviz.train.mask_data import MaskBatch, collate_masks, draw, load_mask_images
from asdfviz.train.mask_losses import LOSSES, mask_losses
from asdfviz.train.mask_validation import MaskValidation, validate_masks
from asdfviz.train.packing import AugmentConfig
from asdfviz.train.schedule import make_optimizer, rate_at

CONFIDENCE = 0.1
"""Of the boxes that validation looks at, as methods have it."""


@dataclass(frozen=True, slots=True)
class MaskReport:
    """What the run says now and then to whoever watches it."""

    step: int
    share: float
    """Of the budget used, 0 to 1."""
    losses: dict[str, float]
    inputs_per_s: float


class MaskSession(Sitting):
    """The state of a run in progress."""

    def __init__(self, config: MaskTrainConfig) -> None:
        """Load detector and pictures, and what an earlier sitting left in the run folder.

        Raises:
            InputError: the config or a scene folder is wrong.
            WeightsError: the detector or the checkpoint is of other assemblies, or corrupt.
        """
        check_mask_config(config)
        torch.set_num_threads(config.threads)
        torch.manual_seed(config.seed)  # pyright: ignore[reportUnknownMemberType] - untyped in torch
        self.config = config
        assemblies = [load_assembly(name) for name in config.assemblies]
        self.names = joint_classes(assemblies)
        loaded = load_network(config.detector)
        if loaded.classes != self.names:
            raise WeightsError(
                f"'{config.detector}' was trained for {', '.join(loaded.classes)}; name its "
                "assemblies in their order"
            )
        self.classes = _part_classes(assemblies)
        self.detector = loaded.network.fuse().to(config.device).requires_grad_(False)
        self.detector.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
        self.images = load_mask_images(config.data, assemblies)
        self.unseen = load_mask_images(config.validation, assemblies) if config.validation else ()
        self.branch = self._begun(MaskBranch(self._channels())).to(config.device)
        self.branch.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
        self.optimizer = make_optimizer(
            (self.branch,), learning_rate=config.learning_rate, weight_decay=config.weight_decay
        )
        self.average = Average(self.branch, decay=config.ema)
        super().__init__(config.output, minutes=config.minutes, steps=config.steps)
        config.output.mkdir(parents=True, exist_ok=True)
        if self.last.is_file():
            self.progress = resume_masks(
                self.last,
                branch=self.branch,
                average=self.average,
                optimizer=self.optimizer,
                detector=config.detector,
            )
            self._budget.before = self.progress.seconds
        columns = ("step", "minutes", "rate", "inputs_per_s", *LOSSES)
        self.log = self.csv_log("log.csv", columns)

    def _begun(self, branch: MaskBranch) -> MaskBranch:
        """The branch as another run left it, if one is named."""
        start = self.config.start
        if start is None:
            return branch
        other = read_branch(start)[0].branch
        if other.channels != branch.channels:
            raise WeightsError(f"'{start}' reads features of another size than this detector's")
        return other

    def go(self, report: Callable[[MaskReport], None], stop: Callable[[], bool]) -> bool:
        """Step until the budget is used (True) or `stop` says so (False), which leaves weights, too."""
        log = Alarm(LOG_SECONDS, now=self.seconds)
        checkpoint = Alarm(self.config.checkpoint_minutes * 60, now=self.seconds)
        meter = Meter()
        while self.share < 1 and not stop():
            self.step(meter)
            if log.rings(self.seconds):
                report(self._logged(meter))
                meter = Meter()
            if checkpoint.rings(self.seconds):
                self.checkpoint()
        if meter.steps:
            report(self._logged(meter))
        self.checkpoint()
        finished = self.share >= 1
        if not finished:
            self._export(None)
        return finished

    def batch(self, step: int) -> MaskBatch:
        """The inputs of a step; the same for the same seed, step and pictures."""
        config, augment = self.config, AugmentConfig()
        rng = np.random.default_rng([config.seed, step])
        samples = [
            draw(
                self.images[int(rng.integers(len(self.images)))],
                rng,
                width=config.width,
                height=config.height,
                config=augment,
            )
            for _ in range(config.batch)
        ]
        return collate_masks(samples).to(config.device)

    def step(self, meter: Meter) -> None:
        """Take one optimiser step."""
        config = self.config
        for group in self.optimizer.param_groups:
            group["lr"] = rate_at(config, self.progress.step, min(self.share, 1.0))
        batch = self.batch(self.progress.step)
        losses = self.losses(batch)
        total = losses[0] + config.dice_gain * losses[1]
        descend(
            total,
            self.optimizer,
            [*self.branch.parameters()],
            clip=config.clip,
            step=self.progress.step,
        )
        self.average.update(self.branch)
        self.progress.step += 1
        meter.add(losses.detach(), len(batch.images), int(batch.targets.present.sum()))

    def losses(self, batch: MaskBatch) -> Float[Tensor, "2"]:
        """Cross-entropy and dice of a batch; gradients reach the branch alone."""
        config = self.config
        images = batch.images.permute(0, 3, 1, 2).float() / 255
        images = images.contiguous(memory_format=torch.channels_last)
        half = config.bfloat16 and has_bfloat16(config.device)
        self.branch.train()
        with torch.autocast(torch.device(config.device).type, torch.bfloat16, enabled=half):
            with torch.no_grad():
                raw = self.detector(images)
            masks = self.branch(raw.maps)
        stride = raw.strides[:, None]
        assignment = assign(
            raw.scores.transpose(1, 2).sigmoid(),
            decode_boxes(raw) * stride,
            raw.anchors * stride,
            raw.strides,
            batch.targets,
            config=AssignerConfig(nearest=True),
        )
        return mask_losses(
            masks, assignment, batch, positives=config.positives, margin=config.margin
        )

    def finish(self) -> MaskValidation | None:
        """Export the averaged weights and judge them on unseen pictures, if there are any."""
        path = self._export(None)
        if not self.unseen:
            return None
        detectors = {
            name: Detector(
                self.config.detector,
                config=DetectorConfig(confidence=CONFIDENCE, device=self.config.device),
                assembly=name,
                masks=path,
            )
            for name in {image.picture.assembly for image in self.unseen}
        }
        found = validate_masks(detectors.__getitem__, self.unseen, self.names)
        self._export(found)
        return found

    def _export(self, found: MaskValidation | None) -> Path:
        branch = MaskBranch(self.branch.channels)
        branch.load_state_dict({k: v.cpu() for k, v in self.average.state.items()})
        return export_masks(self.config, branch, self.progress, classes=self.classes, found=found)

    def checkpoint(self) -> None:
        """Write last.pt with all that is needed to go on."""
        self.progress.seconds = self.seconds
        save_mask_checkpoint(
            self.last,
            branch=self.branch,
            average=self.average,
            progress=self.progress,
            optimizer=self.optimizer,
            detector=self.config.detector,
        )

    def _channels(self) -> tuple[int, ...]:
        """Of the detector's neck, as it runs."""
        side = self.detector.strides[-1]
        with torch.no_grad():
            maps = self.detector(torch.zeros(1, 3, side, side, device=self.config.device)).maps
        return tuple(x.shape[1] for x in maps)

    def _logged(self, meter: Meter) -> MaskReport:
        losses = dict(zip(LOSSES, meter.means(), strict=True))
        report = MaskReport(self.progress.step, min(self.share, 1.0), losses, meter.inputs_per_s)
        values = {"step": float(report.step), "minutes": self.seconds / 60}
        values |= {"rate": self.optimizer.param_groups[0]["lr"]}
        self.log.add({**values, "inputs_per_s": report.inputs_per_s, **losses})
        write_curve(self.config.output / "curve.png", self.log, x="minutes", curves=LOSSES)
        return report


def _part_classes(assemblies: Sequence[Assembly]) -> tuple[str, ...]:
    """Classes that have masks, named as the detector's are."""
    names: list[str] = []
    for assembly in assemblies:
        prefix = f"{assembly.name}{SEPARATOR}" if len(assemblies) > 1 else ""
        names += [prefix + part.detector_class for part in assembly.parts.values()]
    return tuple(dict.fromkeys(names))
