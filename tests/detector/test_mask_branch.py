"""Shapes of the mask branch, masks of coefficients made by hand, weights, and the detector with it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from asdfviz.detector.detector import Detector, DetectorConfig
from asdfviz.detector.letterbox import plan_letterbox
from asdfviz.detector.mask_branch import STRIDE, MaskBranch, box_mask
from asdfviz.detector.mask_weights import load_masks, save_masks
from asdfviz.detector.network import Network
from asdfviz.detector.weights import save_network
from asdfviz.errors import InputError, WeightsError

CLASSES = ("base", "jaw", "clamp:jaw")
CHANNELS = (64, 128, 256)
"""Of the neck of size n."""


@pytest.mark.parametrize("channels", [CHANNELS, (8, 16, 16, 24)])
def test_prototypes_are_at_stride_4_and_every_anchor_has_coefficients(
    channels: tuple[int, ...],
) -> None:
    sides = [(24 >> level, 40 >> level) for level in range(len(channels))]
    maps = tuple(torch.randn(2, c, *side) for c, side in zip(channels, sides, strict=True))
    masks = MaskBranch(channels)(maps)
    assert masks.prototypes.shape == (2, 32, 48, 80)
    assert masks.coefficients.shape == (2, 32, sum(h * w for h, w in sides))


def test_a_fused_branch_gives_the_same() -> None:
    torch.manual_seed(0)
    branch = MaskBranch(CHANNELS)
    maps = tuple(torch.randn(1, c, 16 >> i, 16 >> i) for i, c in enumerate(CHANNELS))
    branch(maps)  # running statistics that are not the starting ones
    branch.eval()
    with torch.no_grad():
        plain = branch(maps)
        fused = branch.fuse()(maps)
    torch.testing.assert_close(fused.prototypes, plain.prototypes, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(fused.coefficients, plain.coefficients, atol=1e-4, rtol=1e-4)


def ramps(width: int, height: int) -> np.ndarray:
    """Prototypes that say where they are: x and y of the network's input, and ones."""
    y, x = np.mgrid[: height // STRIDE, : width // STRIDE]
    x, y = (x + 0.5) * STRIDE, (y + 0.5) * STRIDE
    return np.stack([x, y, np.ones(x.shape)]).astype(np.float32)


@pytest.mark.parametrize("size_wh", [(640, 360), (1280, 720), (320, 180)])
def test_a_mask_is_where_the_sum_of_prototypes_is_positive(size_wh: tuple[int, int]) -> None:
    plan = plan_letterbox(*size_wh, image_size=640, stride=32)
    zoom = size_wh[0] / 640
    box = np.array([60.0, 40.0, 200.0, 150.0]) * zoom
    # x + 2 y > 300 in pixels of the network's input
    coefficients = np.array([1.0, 2.0, -300.0], np.float32)
    mask = box_mask(
        coefficients, ramps(plan.width, plan.height), box_xyxy=box, plan=plan, size_wh=size_wh
    )
    assert mask is not None
    rows, columns = np.mgrid[: mask.pixels.shape[0], : mask.pixels.shape[1]]
    pixels = np.stack([columns + mask.left, rows + mask.top], axis=-1).astype(float)
    at = plan.to_network(pixels)
    assert (mask.pixels == (at[..., 0] + 2 * at[..., 1] >= 300)).all()
    assert (mask.left, mask.top) == (60 * zoom, 40 * zoom)
    assert mask.pixels.shape == (110 * zoom + 1, 140 * zoom + 1)


def test_a_mask_is_cut_at_the_picture_s_border() -> None:
    plan = plan_letterbox(640, 360, image_size=640, stride=32)
    ones = np.ones((1, 96, 160), np.float32)
    everywhere = np.ones(1, np.float32)

    def cut(*box: float):
        return box_mask(everywhere, ones, box_xyxy=np.array(box), plan=plan, size_wh=(640, 360))

    mask = cut(-20.0, 340.5, 9.9, 900.0)
    assert mask is not None
    assert (mask.left, mask.top, mask.pixels.shape) == (0, 341, (19, 10))
    assert mask.pixels.all()
    assert cut(-50.0, 10.0, -3.0, 20.0) is None


@pytest.fixture(scope="module")
def detector_weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    network = Network("n", classes=len(CLASSES))
    with torch.no_grad():
        for branch in network.head.cv3:
            *_, last = branch.children()
            assert isinstance(last, torch.nn.Conv2d)
            assert last.bias is not None
            last.bias.fill_(-1.0)  # boxes above the threshold
    path = tmp_path_factory.mktemp("weights") / "weights.safetensors"
    save_network(network, path, classes=CLASSES, image_size=160)
    return path


@pytest.fixture(scope="module")
def masks(detector_weights: Path) -> Path:
    torch.manual_seed(1)
    path = detector_weights.with_name("masks.safetensors")
    save_masks(MaskBranch(CHANNELS), path, classes=CLASSES[:2], detector=detector_weights)
    return path


def test_weights_come_back_in_half_precision(masks: Path, detector_weights: Path) -> None:
    torch.manual_seed(1)
    own = MaskBranch(CHANNELS).state_dict()
    loaded = load_masks(masks, detector=detector_weights)
    assert loaded.classes == CLASSES[:2]
    for name, value in loaded.branch.state_dict().items():
        torch.testing.assert_close(value, own[name], atol=1e-3, rtol=1e-3)
    assert masks.stat().st_size < 700_000


def test_missing_weights_say_how_to_get_some(tmp_path: Path, detector_weights: Path) -> None:
    with pytest.raises(WeightsError, match="train-masks"):
        load_masks(tmp_path / "none.safetensors", detector=detector_weights)


def test_a_branch_of_other_detector_weights_is_refused(masks: Path, tmp_path: Path) -> None:
    other = tmp_path / "weights.safetensors"
    save_network(Network("n", classes=3), other, classes=CLASSES, image_size=160)
    with pytest.raises(WeightsError, match="other weights"):
        load_masks(masks, detector=other)


@pytest.mark.parametrize("kept", [0, 100, 20_000])
def test_a_file_cut_short_is_refused(
    kept: int, masks: Path, detector_weights: Path, tmp_path: Path
) -> None:
    file = tmp_path / "masks.safetensors"
    file.write_bytes(masks.read_bytes()[:kept])
    with pytest.raises(WeightsError, match="not a whole safetensors"):
        load_masks(file, detector=detector_weights)


def test_what_is_no_mask_branch_is_refused(detector_weights: Path, tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match="format"):
        load_masks(detector_weights, detector=detector_weights)
    branch, file = MaskBranch(CHANNELS), tmp_path / "masks.safetensors"
    with torch.no_grad():
        next(branch.parameters()).fill_(float("nan"))
    save_masks(branch, file, classes=CLASSES, detector=detector_weights)
    with pytest.raises(WeightsError, match="not finite"):
        load_masks(file, detector=detector_weights)
    save_masks(MaskBranch((8, 8)), file, classes=CLASSES, detector=detector_weights)
    whole = load_masks(file, detector=detector_weights)
    from safetensors import safe_open

    with safe_open(file, framework="pt") as opened:
        metadata = opened.metadata()
    some = dict(list(whole.branch.state_dict().items())[:-1])
    save_file(some, file, metadata=metadata)
    with pytest.raises(WeightsError, match="does not fit"):
        load_masks(file, detector=detector_weights)


def test_masks_leave_every_bit_of_a_detection(detector_weights: Path, masks: Path) -> None:
    rgb = np.random.default_rng(2).integers(0, 255, (90, 160, 3), dtype=np.uint8)
    config = DetectorConfig(image_size=160, confidence=0.2)
    plain = Detector(detector_weights, config=config).detect(rgb)
    masked = Detector(detector_weights, config=config, masks=masks).detect(rgb)
    assert len(plain) == len(masked) > 0
    for a, b in zip(plain, masked, strict=True):
        assert a.mask is None
        for field in dataclasses.fields(a):
            if field.name != "mask":
                assert np.array_equal(getattr(a, field.name), getattr(b, field.name))
        # States have no masks.
        assert b.label == CLASSES[2] or b.mask is not None
        if b.mask is not None:
            height, width = b.mask.pixels.shape
            assert b.mask.left >= b.box_xyxy[0]
            assert b.mask.top + height - 1 <= b.box_xyxy[3]
            assert b.mask.left + width <= 160
    assert {d.label for d in masked} > {CLASSES[2]}


def test_other_backends_give_no_masks(
    detector_weights: Path, masks: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from asdfviz.detector import detector

    monkeypatch.setattr(detector, "make_run", lambda *_, **__: None)  # as if it were installed
    config = DetectorConfig(image_size=160, backend="onnxruntime")
    with pytest.raises(InputError, match="gives no masks"):
        Detector(detector_weights, config=config, masks=masks)
