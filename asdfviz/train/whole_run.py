"""Checkpoints of the networks that are trained whole, crop network and mask branch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import torch
from torch import Tensor, nn

from asdfviz.train.checkpoint import Average, Progress


def whole_run(
    network: nn.Module,
    *,
    average: Average,
    progress: Progress,
    optimizer: torch.optim.Optimizer,
    about: str,
) -> dict[str, object]:
    """The content of a checkpoint with one network and its optimiser.

    Args:
        network: being trained.
        average: of its weights.
        progress: how far the run is.
        optimizer: with its state.
        about: what must be the same when the run goes on.
    """
    return {
        "network": network.state_dict(),
        "average": average.state,
        "updates": average.updates,
        "progress": [progress.step, progress.seconds, progress.best],
        "about": about,
        "optimizer": optimizer.state_dict(),
    }


def resume_whole(
    content: Mapping[str, Any],
    network: nn.Module,
    *,
    average: Average,
    optimizer: torch.optim.Optimizer,
) -> Progress:
    """Bring network, average and optimiser to where `whole_run` was; returns how far that is."""
    network.load_state_dict(content["network"])
    state = cast(dict[str, Tensor], content["average"])
    average.state = {k: v.to(average.state[k].device) for k, v in state.items()}
    average.updates = content["updates"]
    optimizer.load_state_dict(content["optimizer"])
    return Progress(*content["progress"])
