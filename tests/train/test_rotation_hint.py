from __future__ import annotations

import torch

from asdfviz.detector.assigner import Assignment
from asdfviz.detector.head import RawOutput
from asdfviz.train.rotation_hint import RotationHint


def test_the_hint_learns_to_tell_two_rotations_apart() -> None:
    torch.manual_seed(0)
    hint = RotationHint(classes=2, width=8, levels=1, rotations=60)
    features = torch.randn(2, 8, 1, 1)
    raw = RawOutput(
        boxes=torch.zeros(2, 64, 1),
        scores=torch.zeros(2, 2, 1),
        keypoints=torch.zeros(2, 51, 1),
        anchors=torch.zeros(1, 2),
        strides=torch.ones(1),
        features=(features,),
    )
    assignment = Assignment(
        positive=torch.ones(2, 1, dtype=torch.bool),
        objects=torch.zeros(2, 1, dtype=torch.long),
        scores=torch.ones(2, 1, 2),
    )
    rotations = torch.stack([torch.eye(3), torch.diag(torch.tensor([-1.0, -1.0, 1.0]))])[:, None]
    labels = torch.zeros(2, 1, dtype=torch.long)
    optimizer = torch.optim.Adam(hint.parameters(), lr=0.1)
    losses: list[float] = []
    for _ in range(60):
        loss = hint(raw, assignment, labels, rotations)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    assert losses[-1] < 0.6 * losses[0]
    nothing = hint(raw, assignment, labels, torch.zeros_like(rotations))
    assert float(nothing.detach()) == 0.0
