"""Optimiser, learning rate and stages over the budget of a run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import torch
from torch import nn

from asdfviz.train.config import Stage, TrainConfig
from asdfviz.train.crop_config import CropTrainConfig
from asdfviz.train.mask_config import MaskTrainConfig
from asdfviz.train.state_config import StateTrainConfig


def make_optimizer(
    modules: Iterable[nn.Module], *, learning_rate: float, weight_decay: float
) -> torch.optim.AdamW:
    """Return AdamW with decay on weights of convolutions, none on biases and norms."""
    decayed: list[nn.Parameter] = []
    others: list[nn.Parameter] = []
    for module in modules:
        for parameter in module.parameters():
            if parameter.requires_grad:
                (decayed if parameter.ndim > 1 else others).append(parameter)
    groups = [
        {"params": decayed, "weight_decay": weight_decay},
        {"params": others, "weight_decay": 0.0},
    ]
    return torch.optim.AdamW(groups, lr=learning_rate, betas=(0.9, 0.99))


def rate_at(
    config: TrainConfig | CropTrainConfig | MaskTrainConfig | StateTrainConfig,
    step: int,
    share: float,
) -> float:
    """Return the learning rate: warm-up by steps, level for `hold`, then half a cosine."""
    warm = min(1.0, (step + 1) / max(config.warmup_steps, 1))
    late = min(max((share - config.hold) / max(1 - config.hold, 1e-9), 0.0), 1.0)
    cosine = (1 + math.cos(math.pi * late)) / 2
    return config.learning_rate * warm * (config.final_rate + (1 - config.final_rate) * cosine)


def recipe_stage(config: TrainConfig, share: float) -> Stage:
    """Return the stage that a share of the budget lies in, without tiles where the run closes."""
    stage = stage_at(config.stages, share)
    is_closing = config.closing > 0 and share >= 1 - config.closing
    return replace(stage, packed=0.0) if is_closing else stage


def stage_at(stages: Sequence[Stage], share: float) -> Stage:
    """Return the stage that a share of the budget lies in."""
    total = sum(stage.share for stage in stages)
    end = 0.0
    for stage in stages:
        end += stage.share / total
        if share < end:
            return stage
    return stages[-1]
