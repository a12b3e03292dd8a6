from __future__ import annotations

import torch

from asdfviz.detector.assigner import Assignment
from asdfviz.detector.head import RawOutput
from asdfviz.train.rotation_hint import RotationHint


def output(*features: torch.Tensor, classes: int) -> RawOutput:
    """A head's output that says nothing but its features, of two pictures."""
    anchors = sum(f.shape[-2] * f.shape[-1] for f in features)
    return RawOutput(
        boxes=torch.zeros(2, 64, anchors),
        scores=torch.zeros(2, classes, anchors),
        keypoints=torch.zeros(2, 51, anchors),
        anchors=torch.zeros(anchors, 2),
        strides=torch.ones(anchors),
        features=features,
    )


def test_the_hint_learns_to_tell_two_rotations_apart() -> None:
    torch.manual_seed(0)
    hint = RotationHint(classes=2, width=8, levels=1, rotations=60)
    features = torch.randn(2, 8, 1, 1)
    raw = output(features, classes=2)
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


def test_each_anchor_is_asked_by_the_classifier_of_its_level_and_class() -> None:
    torch.manual_seed(1)
    hint = RotationHint(classes=3, width=8, levels=2, rotations=40)
    torch.nn.init.normal_(hint.bias)
    fine, coarse = torch.randn(2, 8, 2, 2), torch.randn(2, 8, 1, 1)
    raw = output(fine, coarse, classes=3)
    positive = torch.tensor([[1, 0, 1, 1, 1], [0, 1, 1, 0, 1]], dtype=torch.bool)
    objects = torch.tensor([[0, 0, 1, 2, 1], [0, 2, 0, 0, 1]])
    assignment = Assignment(positive=positive, objects=objects, scores=torch.ones(2, 5, 3))
    labels = torch.tensor([[2, 0, 1], [0, 2, 2]])
    rotations = hint.grid[torch.tensor([[3, 7, 11], [13, 17, 19]])].clone()
    rotations[0, 2] = 0  # a state has no rotation

    expected: list[torch.Tensor] = []
    columns = torch.cat([fine.flatten(2), coarse.flatten(2)], 2)
    for image, anchor in positive.nonzero().tolist():
        row = int(objects[image, anchor])
        if (image, row) == (0, 2):
            continue
        kind = int(labels[image, row])
        logits = columns[image, :, anchor] @ hint.weight[int(anchor == 4), kind] + hint.bias[kind]
        soft = hint._soft_labels(rotations[image, row][None])[0]
        expected.append(-(soft * logits.log_softmax(0)).sum())
    loss = hint(raw, assignment, labels, rotations)
    torch.testing.assert_close(loss, torch.stack(expected).mean())
