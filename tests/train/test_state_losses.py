from __future__ import annotations

import math

import pytest
import torch

from asdfviz.train.state_losses import smoothed_entropy

NO = -math.inf


def test_a_share_of_the_target_lies_on_all_states_that_may_be() -> None:
    logits = torch.tensor([[math.log(0.7), math.log(0.3), NO], [NO, math.log(0.5), math.log(0.5)]])
    targets = torch.tensor([0, 2])
    plain = -(math.log(0.7) + math.log(0.5)) / 2
    spread = -(math.log(0.7) + math.log(0.3) + 2 * math.log(0.5)) / 4
    for share in (0.0, 0.1, 1.0):
        found = float(smoothed_entropy(logits, targets, smoothing=share))
        assert found == pytest.approx((1 - share) * plain + share * spread, rel=1e-6)


def test_gradients_are_finite_where_states_cannot_be() -> None:
    values = torch.tensor([[1.0, -2.0, 0.5]], requires_grad=True)
    masked = values.masked_fill(torch.tensor([[False, False, True]]), NO)
    smoothed_entropy(masked, torch.tensor([1]), smoothing=0.1).backward()
    assert values.grad is not None
    assert torch.isfinite(values.grad).all()
    assert values.grad[0, 2] == 0
