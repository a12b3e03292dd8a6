"""What the state network is trained by."""

from __future__ import annotations

import torch
from jaxtyping import Float32, Int64
from torch import Tensor
from torch.nn.functional import cross_entropy


def smoothed_entropy(
    logits: Float32[Tensor, "b s"], targets: Int64[Tensor, "b"], *, smoothing: float
) -> Float32[Tensor, ""]:
    """Mean cross-entropy in nats, a share of each target spread over all states that may be.

    Args:
        logits: of states, minus infinity for those that cannot be; each row has one that can.
        targets: the true states, which can be.
        smoothing: the share, 0 to 1; 0 is the plain cross-entropy.
    """
    plain = cross_entropy(logits, targets)
    may_be = torch.isfinite(logits)
    surprise = -torch.log_softmax(logits, dim=1).masked_fill(~may_be, 0.0)
    spread = surprise.sum(dim=1) / may_be.sum(dim=1)
    return (1 - smoothing) * plain + smoothing * spread.mean()
