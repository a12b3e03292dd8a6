from __future__ import annotations

import pytest
import torch
from torch import Tensor

from asdfviz.detector.assigner import AssignerConfig, Assignment, Targets, assign, ciou


def test_ciou_of_known_boxes() -> None:
    box = torch.tensor([[0.0, 0.0, 4.0, 4.0]])
    assert float(ciou(box, box)) == pytest.approx(1.0, abs=1e-5)
    shifted = torch.tensor([[2.0, 0.0, 6.0, 4.0]])
    # IoU 8 / 24, centres 2 apart, hull 6 x 4, equal shapes.
    assert float(ciou(box, shifted)) == pytest.approx(1 / 3 - 4 / 52, abs=1e-5)
    apart = torch.tensor([[10.0, 10.0, 12.0, 12.0]])
    assert float(ciou(box, apart)) < 0


def grid(side: int = 8, stride: int = 8) -> tuple[Tensor, Tensor]:
    rows = (torch.arange(side) + 0.5) * stride
    y, x = torch.meshgrid(rows, rows, indexing="ij")
    return torch.stack([x, y], -1).view(-1, 2), torch.full((side * side,), float(stride))


def targets(*boxes: tuple[float, float, float, float]) -> Targets:
    count = len(boxes)
    return Targets(
        labels=torch.arange(count)[None] % 2,
        boxes=torch.tensor(boxes, dtype=torch.float32).view(1, count, 4),
        keypoints=torch.zeros(1, count, 17, 3),
        present=torch.ones(1, count, dtype=torch.bool),
    )


def run(labels: Targets, **options: object) -> Assignment:
    """Assign where every anchor predicts a 16 px box about itself and half a score."""
    anchors, strides = grid()
    boxes = torch.cat([anchors - 8, anchors + 8], 1)[None]
    scores = torch.full((1, len(anchors), 2), 0.5)
    return assign(
        scores,
        boxes,
        anchors,
        strides,
        labels,
        config=AssignerConfig(**options),  # type: ignore[arg-type]
    )


def test_an_object_gets_its_best_anchors_inside_its_box() -> None:
    found = run(targets((8, 8, 40, 40)), candidates=3)
    anchors, _ = grid()
    chosen = anchors[found.positive[0]]
    assert len(chosen) == 3
    assert ((chosen > 8) & (chosen < 40)).all()
    # The four middle anchors fit best: three of them are taken.
    assert ((chosen - 24).abs() <= 4).all()


def test_the_soft_target_peaks_at_the_best_overlap() -> None:
    found = run(targets((16, 16, 32, 32)))
    anchors, _ = grid()
    overlap = ciou(torch.tensor([[16.0, 16, 32, 32]]), torch.cat([anchors - 8, anchors + 8], 1))
    inside = found.positive[0]
    assert float(found.scores[0, :, 0].max()) == pytest.approx(
        float(overlap[inside].max()), rel=1e-4
    )
    assert float(found.scores[0, :, 1].max()) == 0.0


def test_a_disputed_anchor_goes_to_the_higher_overlap() -> None:
    found = run(targets((8, 8, 24, 24), (0, 0, 64, 64)))
    anchors, _ = grid()
    place = int((anchors - torch.tensor([12.0, 12.0])).norm(dim=1).argmin())
    assert int(found.objects[0, place]) == 0


def test_a_tiny_box_gets_nobody_unless_asked_for() -> None:
    tiny = targets((15, 15, 17, 17))
    assert not run(tiny).positive.any()
    found = run(tiny, nearest=True)
    assert int(found.positive.sum()) == 1
    anchors, _ = grid()
    assert float((anchors[found.positive[0]] - 16).norm()) == pytest.approx(32**0.5)


def test_padding_is_never_assigned() -> None:
    labels = targets((8, 8, 40, 40), (8, 8, 40, 40))
    labels.present[0, 1] = False
    found = run(labels, nearest=True)
    assert (found.objects[found.positive] == 0).all()
