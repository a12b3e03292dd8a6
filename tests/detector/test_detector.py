from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from asdfviz.detector.detector import Detector, DetectorConfig, detect
from asdfviz.detector.head import RawOutput, anchor_points
from asdfviz.detector.network import Network
from asdfviz.detector.weights import save_network

CLASSES = ("body", "bolt", "toy:joined")


class Oracle(Network):
    """Answers with one object at known places of its input, whatever it sees."""

    def __init__(self, keypoints_network: np.ndarray, box_network: np.ndarray) -> None:
        super().__init__("n", classes=3)
        self._points, self._box = torch.as_tensor(keypoints_network), torch.as_tensor(box_network)

    def forward(self, images: torch.Tensor) -> RawOutput:
        h, w = images.shape[2:]
        maps = [torch.zeros(1, 1, h // s, w // s) for s in self.strides]
        anchors, strides = anchor_points(maps, self.strides)
        count = len(anchors)
        middle = (self._box[:2] + self._box[2:]) / 2
        # An anchor of stride 16, so that the sides fit into 16 bins.
        far = torch.where(strides == 16, 0.0, 1e6)
        place = int(((anchors * strides[:, None] - middle).norm(dim=1) + far).argmin())
        scores = torch.full((1, 3, count), -20.0)
        scores[0, :2, place] = torch.tensor([-2.0, 3.0])
        centre = anchors[place] * 16
        sides = torch.cat([centre - self._box[:2], self._box[2:] - centre]) / 16
        boxes = torch.zeros(1, 64, count)
        left = sides.floor().long()
        for side in range(4):
            logits = torch.full((16,), -40.0)
            share = sides[side] - left[side]
            logits[left[side]] = torch.log(1 - share)
            logits[left[side] + 1] = torch.log(share)
            boxes[0, side * 16 : side * 16 + 16, place] = logits
        values = torch.zeros(17, 3)
        values[:, :2] = (self._points / 16 - (anchors[place] - 0.5)) / 2
        keypoints = torch.zeros(1, 51, count)
        keypoints[0, :, place] = values.flatten()
        return RawOutput(boxes, scores, keypoints, anchors, strides)


@pytest.mark.parametrize(("width", "height"), [(640, 360), (1280, 720), (960, 540), (320, 240)])
def test_what_the_network_says_comes_out_in_frame_pixels(width: int, height: int) -> None:
    """An integer is a pixel's centre in frames, a half in the network: both are kept apart."""
    rng = np.random.default_rng(2)
    scale = 640 / width
    points = rng.uniform([0.3 * width, 0.3 * height], [0.5 * width, 0.6 * height], (17, 2))
    box = np.array([0.29 * width, 0.28 * height, 0.51 * width, 0.62 * height])
    top = (np.ceil(height * scale / 32) * 32 - height * scale) // 2

    def to_network(p: np.ndarray) -> np.ndarray:
        return (p + 0.5) * scale + [0, top]

    oracle = Oracle(
        to_network(points).astype(np.float32),
        to_network(box.reshape(2, 2)).reshape(4).astype(np.float32),
    ).eval()
    frame = np.zeros((height, width, 3), np.uint8)
    (found,) = detect(oracle, frame, classes=CLASSES, config=DetectorConfig())
    assert found.label == "bolt"
    assert found.score == pytest.approx(1 / (1 + np.exp(-3.0)), rel=1e-5)
    assert found.class_scores == pytest.approx({"body": 1 / (1 + np.exp(2.0)), "bolt": found.score})
    np.testing.assert_allclose(found.keypoints_px, points, atol=1e-3)
    np.testing.assert_allclose(found.box_xyxy, box, atol=1e-2)


@pytest.fixture
def weights(tiny_network: Network, tmp_path: Path) -> Path:
    save_network(tiny_network, tmp_path / "w.safetensors", classes=CLASSES, image_size=640)
    return tmp_path / "w.safetensors"


def test_detections_are_repeatable_and_sorted(weights: Path) -> None:
    detector = Detector(weights, config=DetectorConfig(confidence=1e-6, max_detections=20))
    rgb = np.random.default_rng(0).integers(0, 255, (90, 160, 3), dtype=np.uint8)
    first = detector.detect(rgb)
    detector.detect(np.zeros((60, 60, 3), np.uint8))
    second = detector.detect(rgb)
    assert 0 < len(first) <= 20
    assert [d.score for d in first] == sorted((d.score for d in first), reverse=True)
    for a, b in zip(first, second, strict=True):
        assert (a.label, a.score) == (b.label, b.score)
        np.testing.assert_array_equal(a.keypoints_px, b.keypoints_px)
    assert {d.label for d in first} <= set(CLASSES)


def test_nothing_above_the_threshold_is_an_empty_answer(weights: Path) -> None:
    detector = Detector(weights, config=DetectorConfig(confidence=0.999))
    assert detector.detect(np.zeros((48, 64, 3), np.uint8)) == ()


def test_bfloat16_says_nearly_the_same(weights: Path) -> None:
    rgb = np.random.default_rng(0).integers(0, 255, (96, 160, 3), dtype=np.uint8)
    exact = Detector(weights, config=DetectorConfig(confidence=1e-6)).detect(rgb)
    fast = Detector(weights, config=DetectorConfig(confidence=1e-6, bfloat16=True)).detect(rgb)
    assert exact
    assert fast[0].score == pytest.approx(exact[0].score, rel=0.2)
