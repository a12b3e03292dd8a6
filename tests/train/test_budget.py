from __future__ import annotations

import pytest
import torch
from torch import nn

from asdfviz.errors import InputError
from asdfviz.train.budget import Alarm, Budget, descend


def test_a_budget_of_steps_counts_steps_and_one_of_minutes_counts_earlier_sittings() -> None:
    assert Budget(minutes=1.0, steps=8).share(2) == 0.25
    budget = Budget(minutes=2.0, steps=None)
    budget.before = 90.0
    assert 0.75 <= budget.share(0) < 0.76
    assert budget.seconds >= 90.0


def test_an_alarm_rings_once_and_waits_anew() -> None:
    alarm = Alarm(20.0, now=100.0, first_s=2.0)
    rung = [now for now in (101.0, 102.5, 103.0, 122.0, 123.0, 124.0, 143.5) if alarm.rings(now)]
    assert rung == [102.5, 123.0, 143.5]
    alarm.wait(150.0)
    assert [now for now in (164.0, 169.0, 171.0) if alarm.rings(now)] == [171.0]


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
