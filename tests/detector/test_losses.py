from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.detector.assigner import AssignerConfig, Targets
from asdfviz.detector.head import RawOutput
from asdfviz.detector.losses import PAPER, PUBLISHED, LossConfig, pose_losses
from asdfviz.detector.network import Network


def reference_targets(data: np.lib.npyio.NpzFile) -> Targets:
    height, width = data["img"].shape[2:]
    image = data["batch_idx"].astype(int)
    count, most = data["img"].shape[0], int(np.bincount(image).max())
    labels = torch.zeros(count, most, dtype=torch.long)
    boxes, keypoints = torch.zeros(count, most, 4), torch.zeros(count, most, 17, 3)
    present = torch.zeros(count, most, dtype=torch.bool)
    for row, i in enumerate(image):
        j = int(present[i].sum())
        x, y, w, h = data["bboxes"][row] * [width, height, width, height]
        labels[i, j] = int(data["cls"][row, 0])
        boxes[i, j] = torch.tensor([x - w / 2, y - h / 2, x + w / 2, y + h / 2])
        keypoints[i, j] = torch.as_tensor(data["keypoints"][row]) * torch.tensor([width, height, 1])
        present[i, j] = True
    return Targets(labels, boxes, keypoints, present)


def test_losses_and_gradients_equal_the_public_ones(
    reference: Path, public_network: Network
) -> None:
    data = np.load(reference / "loss.npz")
    network = public_network.train()
    raw = network(torch.as_tensor(data["img"]))
    losses, _ = pose_losses(raw, reference_targets(data), config=PUBLISHED)
    np.testing.assert_allclose(losses.parts.detach(), data["items"], rtol=1e-5)

    (losses.parts.sum() * len(data["img"])).backward()
    gradients = {n: p.grad for n, p in network.named_parameters() if p.grad is not None}
    for name in (n for n in data.files if n.startswith("grad_")):
        wanted = data[name]
        mine = gradients[name.removeprefix("grad_")].numpy()
        np.testing.assert_allclose(mine, wanted, atol=1e-4 * max(1.0, np.abs(wanted).max()))
    norm = torch.stack([g.norm() for g in gradients.values()]).norm()
    assert float(norm) == pytest.approx(float(data["gradnorm"]), rel=1e-5)


def one_object(*, flags: float = 2.0) -> tuple[RawOutput, Targets]:
    """A 64x64 input with one 30 px object in the middle and a network that says nothing."""
    with torch.device("cpu"):
        network = Network("n", classes=2)
        torch.manual_seed(1)
        raw = network.train()(torch.rand(2, 3, 64, 64))
    keypoints = torch.full((2, 1, 17, 3), 32.0)
    keypoints[..., 2] = flags
    boxes = torch.tensor([[[17.0, 17, 47, 47]]]).repeat(2, 1, 1)
    present = torch.tensor([[True], [False]])
    return raw, Targets(torch.zeros(2, 1, dtype=torch.long), boxes, keypoints, present)


@pytest.mark.parametrize("config", [LossConfig(), PUBLISHED, PAPER])
def test_every_loss_is_finite_and_moves_the_keypoints(config: LossConfig) -> None:
    raw, targets = one_object()
    losses, assignment = pose_losses(raw, targets, config=config)
    assert assignment.positive[0].any()
    assert not assignment.positive[1].any()
    (gradient,) = torch.autograd.grad(losses.keypoint, raw.keypoints)
    assert torch.isfinite(gradient).all()
    assert gradient.abs().sum() > 0


@pytest.mark.parametrize("config", [LossConfig(), PUBLISHED, PAPER])
def test_objects_without_keypoints_teach_none(config: LossConfig) -> None:
    raw, targets = one_object(flags=0.0)
    losses, _ = pose_losses(raw, targets, config=config)
    assert float(losses.keypoint.detach()) == 0.0
    (gradient,) = torch.autograd.grad(losses.keypoint, raw.keypoints)
    assert torch.isfinite(gradient).all()


def test_a_batch_without_objects_has_a_finite_loss() -> None:
    raw, targets = one_object()
    empty = dataclasses.replace(targets, present=torch.zeros_like(targets.present))
    losses, _ = pose_losses(raw, empty, config=LossConfig())
    losses.parts.sum().backward()
    assert torch.isfinite(losses.parts).all()
    assert float(losses.box.detach()) == 0.0


def test_a_small_tolerance_punishes_a_small_error_more() -> None:
    raw, targets = one_object()
    tight = dataclasses.replace(PUBLISHED, sigmas=(0.02,))
    loose = dataclasses.replace(PUBLISHED, sigmas=(0.2,))
    at = {
        name: float(pose_losses(raw, targets, config=config)[0].keypoint.detach())
        for name, config in {"tight": tight, "loose": loose}.items()
    }
    assert at["tight"] > 1.5 * at["loose"]


def test_hidden_keypoints_weigh_less_in_the_mix() -> None:
    config = dataclasses.replace(LossConfig(), assigner=AssignerConfig())
    visible = pose_losses(*one_object(flags=2.0), config=config)[0].keypoint
    hidden = pose_losses(*one_object(flags=1.0), config=config)[0].keypoint
    assert float((hidden / visible).detach()) == pytest.approx(config.occluded_weight, rel=1e-4)
