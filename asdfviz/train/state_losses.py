"""What the state network is trained by."""

from __future__ import annotations

import torch
from jaxtyping import Float32, Int64
from torch import Tensor
from torch.nn.functional import log_softmax, nll_loss


def smoothed_entropy(
    logits: Float32[Tensor, "b s"], targets: Int64[Tensor, "b"], *, smoothing: float
) -> Float32[Tensor, ""]:
    """Mean cross-entropy in nats, a share of each target spread over all states that may be.

    Args:
        logits: of states, minus infinity for those that cannot be; each row has one that can.
        targets: the true states, which can be.
        smoothing: the share, 0 to 1; 0 is the plain cross-entropy.
    """
    log_p = log_softmax(logits, dim=1)
    may_be = torch.isfinite(logits)
    spread = -log_p.masked_fill(~may_be, 0.0).sum(dim=1) / may_be.sum(dim=1)
    return (1 - smoothing) * nll_loss(log_p, targets) + smoothing * spread.mean()
