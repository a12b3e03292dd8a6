"""What a detector's run teaches: the network, its auxiliary head, and their loss on a batch."""

from __future__ import annotations

from typing import cast

import torch
from jaxtyping import Float
from torch import Tensor, nn

from asdfviz.detector.losses import pose_losses
from asdfviz.detector.network import Network
from asdfviz.detector.precision import has_bfloat16
from asdfviz.train.config import TrainConfig
from asdfviz.train.loader import Batch
from asdfviz.train.rotation_hint import RotationHint


def new_learner(config: TrainConfig, *, classes: int, device: str) -> tuple[Network, RotationHint]:
    """Make the network and the head of the rotation hint, with weights of the config's seed."""
    torch.manual_seed(config.seed)  # pyright: ignore[reportUnknownMemberType] - untyped in torch
    width = config.keypoint_width or None
    network = Network(config.scale, classes=classes, keypoint_width=width)
    # Inputs of a stage have one size: what cuDNN finds fastest for the first is so for all.
    torch.backends.cudnn.benchmark = True
    hint_width = cast(nn.Conv2d, cast(nn.Sequential, network.head.cv4[0])[2]).in_channels
    hint = RotationHint(classes=classes, width=hint_width, levels=len(network.strides))
    network = network.to(device)
    network.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
    return network, hint.to(device)


def batch_loss(
    network: Network, hint: RotationHint, batch: Batch, config: TrainConfig
) -> tuple[Float[Tensor, ""], Float[Tensor, "n"]]:
    """Run a batch through the network.

    Args:
        network: in training mode.
        hint: its auxiliary head.
        batch: on the network's device.
        config: of the run.

    Returns:
        The loss to descend, and its parts: those of `pose_losses`, then the hint's.
    """
    images = batch.images.permute(0, 3, 1, 2).float() / 255
    images = images.contiguous(memory_format=torch.channels_last)
    kind = torch.device(config.device).type
    half = config.bfloat16 and has_bfloat16(config.device)
    with torch.autocast(kind, dtype=torch.bfloat16, enabled=half):
        raw = network(images)
    losses, assignment = pose_losses(raw, batch.targets, config=config.losses)
    parts = losses.parts
    turned = parts.new_zeros(())
    if config.rotation_gain > 0:
        turned = hint(raw, assignment, batch.targets.labels, batch.rotations)
    total = parts.sum() + config.keypoint_gain * config.rotation_gain * turned
    return total, torch.cat([parts.detach(), turned.detach()[None]])
