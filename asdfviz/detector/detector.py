"""The detector that methods call: an RGB picture in, labelled boxes with keypoints out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeAlias

import numpy as np
import torch
from jaxtyping import Float32

from asdfviz.datatypes import Detection
from asdfviz.detector.backends import Backend, Runs, TorchRun, make_run
from asdfviz.detector.joint import keep_classes, own_columns
from asdfviz.detector.letterbox import Letterbox, letterbox, plan_letterbox
from asdfviz.detector.mask_run import MaskRun
from asdfviz.detector.network import Network
from asdfviz.detector.nms import suppress
from asdfviz.detector.weights import load_network
from asdfviz.errors import InputError
from asdfviz.geometry.boxes import BoxMask, iou_matrix
from asdfviz.geometry.shapes import Box, Rgb, Scores

CANDIDATES = 1000
"""Boxes that reach the suppression at most; more are the same objects again."""
SAME_PLACE = 0.6
"""Candidates that overlap a box more than this (intersection over union) are in its place."""
LEAST_SCORE = 0.02
"""Of another class that is worth telling."""
MaskOf: TypeAlias = Callable[[str, int, Box], BoxMask | None]
"""The mask of a detection by its label, its place among the candidates and its box."""


@dataclass(frozen=True, slots=True)
class DetectorConfig:
    """What counts as found, and how the network runs."""

    image_size: int = 640
    """Longer side of the network's input, pixels; best the size that it was trained on."""
    confidence: float = 0.25
    """Smallest class score, 0 to 1 (YOLOv8's default)."""
    iou: float = 0.65
    """Overlap above which the weaker of two boxes of a class goes."""
    max_detections: int = 300
    """Boxes a picture (YOLOv8's default)."""
    device: str = "cpu"
    """A torch device."""
    bfloat16: bool = False
    """Run in bfloat16 where the processor has it: faster, keypoints up to a pixel off."""
    backend: Backend = "torch"
    """What computes the network; the others are optional packages, on the CPU alone."""


class Detector:
    """A network with its weights, ready to run; results do not depend on earlier pictures."""

    def __init__(
        self,
        weights: Path,
        *,
        config: DetectorConfig | None = None,
        classes: Sequence[str] | None = None,
        assembly: str | None = None,
        masks: Path | None = None,
    ) -> None:
        """Load the weights.

        Args:
            weights: file for `load_network`.
            config: None means the defaults.
            classes: names for a file that holds none, in the order of the outputs.
            assembly: of a joint network, keep only this assembly's classes.
            masks: weights of a mask branch that was trained on these weights; None: no masks.

        Raises:
            WeightsError: a file is missing, corrupt, of another network or another assembly.
            InputError: the backend is not installed, or gives no masks.
        """
        loaded = load_network(weights, classes=classes)
        network, self.classes = loaded.network, loaded.classes
        if assembly is not None:
            columns = own_columns(loaded.classes, assembly)
            self.classes = tuple(columns)
            if len(columns) < len(loaded.classes):
                network = keep_classes(network, tuple(columns.values()))
        self.config = config or DetectorConfig()
        self._run = make_run(
            network.fuse(),
            backend=self.config.backend,
            device=self.config.device,
            bfloat16=self.config.bfloat16,
        )
        self._masks: MaskRun | None = None
        if masks is not None:
            if self.config.backend != "torch":
                raise InputError(f"the backend {self.config.backend} gives no masks: use torch")
            self._masks = MaskRun.of(
                masks,
                detector=weights,
                assembly=assembly,
                network=network,
                device=self.config.device,
                bfloat16=self.config.bfloat16,
            )

    def detect(self, rgb: Rgb) -> tuple[Detection, ...]:
        """Return what is in the picture, best first, in its own pixels."""
        return _detect(self._run, rgb, classes=self.classes, config=self.config, masks=self._masks)


def detect(
    network: Network, rgb: Rgb, *, classes: tuple[str, ...], config: DetectorConfig
) -> tuple[Detection, ...]:
    """Run a network in evaluation mode on one picture and return what it found, best first."""
    run = TorchRun(network, device=config.device, bfloat16=config.bfloat16)
    return _detect(run, rgb, classes=classes, config=config)


def _detect(
    run: Runs,
    rgb: Rgb,
    *,
    classes: tuple[str, ...],
    config: DetectorConfig,
    masks: MaskRun | None = None,
) -> tuple[Detection, ...]:
    plan = _plan(rgb.shape[1], rgb.shape[0], config.image_size, run.strides[-1])
    picture = torch.as_tensor(letterbox(rgb, plan)).to(config.device)
    images = picture.permute(2, 0, 1)[None].float() / 255
    answer = None if masks is None else masks(images)
    columns = (run(images) if answer is None else answer[0])[0].T
    scores = columns[:, 4 : 4 + len(classes)].amax(1)
    found = (scores > config.confidence).nonzero()[:, 0]
    if len(found) > CANDIDATES:
        found = found[scores[found].topk(CANDIDATES).indices]
    mask_of: MaskOf | None = None
    if masks is not None and answer is not None:
        size_wh = (rgb.shape[1], rgb.shape[0])
        mask_of = masks.cutter(answer[1], found, plan=plan, size_wh=size_wh)
    return _detections(columns[found].cpu().numpy(), plan, classes, config, mask_of)


@lru_cache(maxsize=16)
def _plan(width: int, height: int, image_size: int, stride: int) -> Letterbox:
    return plan_letterbox(width, height, image_size=image_size, stride=stride)


def _detections(
    rows: Float32[np.ndarray, "n c"],
    plan: Letterbox,
    classes: tuple[str, ...],
    config: DetectorConfig,
    mask_of: MaskOf | None,
) -> tuple[Detection, ...]:
    values = rows.astype(np.float64)
    centre, half = values[:, :2], values[:, 2:4] / 2
    boxes = np.concatenate([centre - half, centre + half], axis=1)
    class_scores = values[:, 4 : 4 + len(classes)]
    labels = class_scores.argmax(1).astype(np.int64) if len(values) else np.zeros(0, np.int64)
    scores = class_scores.max(1) if len(values) else np.zeros(0)
    kept = suppress(boxes, scores, labels, iou=config.iou, limit=config.max_detections)
    in_place = iou_matrix(boxes[kept], boxes) > SAME_PLACE
    found: list[Detection] = []
    for place, near in zip(kept, in_place, strict=True):
        keypoints = values[place, 4 + len(classes) :].reshape(-1, 3)
        label = classes[labels[place]]
        box_xyxy = plan.to_frame(boxes[place].reshape(2, 2)).reshape(4)
        found.append(
            Detection(
                label=label,
                box_xyxy=box_xyxy,
                keypoints_px=plan.to_frame(keypoints[:, :2]),
                keypoint_scores=keypoints[:, 2].copy(),
                score=float(scores[place]),
                mask=None if mask_of is None else mask_of(label, int(place), box_xyxy),
                class_scores=_class_scores(class_scores[near].max(axis=0), classes),
            )
        )
    return tuple(found)


def _class_scores(scores: Scores, classes: tuple[str, ...]) -> dict[str, float]:
    """The scores that are worth telling, by class."""
    return {classes[i]: float(scores[i]) for i in np.flatnonzero(scores > LEAST_SCORE)}
