from __future__ import annotations

import pytest
import torch
from torch import nn

from asdfviz.errors import InputError
from asdfviz.train.budget import Budget, descend


def test_a_budget_of_steps_counts_steps_and_one_of_minutes_counts_earlier_sittings() -> None:
    assert Budget(minutes=1.0, steps=8).share(2) == 0.25
    budget = Budget(minutes=2.0, steps=None)
    budget.before = 90.0
    assert 0.75 <= budget.share(0) < 0.76
    assert budget.seconds >= 90.0


def test_a_step_goes_down_the_loss_with_gradients_held() -> None:
    weight = nn.Parameter(torch.tensor([3.0, 4.0]))
    optimizer = torch.optim.SGD([weight], lr=1.0)
    descend((weight**2).sum(), optimizer, [weight], clip=1.0, step=0)
    # The gradient (6, 8) of length 10 is held to length 1.
    torch.testing.assert_close(weight.detach(), torch.tensor([2.4, 3.2]))
    shared: list[int] = []
    descend(
        weight.sum(),
        optimizer,
        [weight],
        clip=1.0,
        step=1,
        share_gradients=lambda parameters: shared.append(len(parameters)),
    )
    assert shared == [1]


def test_a_loss_that_is_not_finite_changes_nothing() -> None:
    weight = nn.Parameter(torch.ones(2))
    optimizer = torch.optim.SGD([weight], lr=0.5)
    with pytest.raises(InputError, match=r"step 7: lower the learning rate \(0\.5\)"):
        descend(weight.sum() * torch.inf, optimizer, [weight], clip=1.0, step=7)
    assert (weight == 1).all()
