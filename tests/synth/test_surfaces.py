"""Detail of printed plastic and of skin."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from asdfviz.synth.surfaces import COLUMNS, decorate


def _looks(
    *,
    depth: float,
    translucency: float,
    local: np.ndarray,
    edge: float = 0.0,
    mark: float = -3.0,
) -> tuple[Tensor, Tensor]:
    """Looks of a grey surface that faces +x, its layers along z."""
    finish = torch.zeros(len(local), COLUMNS)
    finish[:, :3] = 0.4
    finish[:, 5], finish[:, 6], finish[:, 7], finish[:, 8] = 2, 0.0006, depth, translucency
    finish[:, 11], finish[:, 12] = 1.0, 1.0
    normal = torch.zeros(len(local), 3)
    normal[:, 0] = 1.0
    footprint = torch.full((len(local),), 0.001)
    places = torch.tensor(local, dtype=torch.float32)
    rim, marks = torch.full_like(footprint, edge), torch.full_like(footprint, mark)
    return decorate(finish, places, normal, rim, footprint, marks)


def _places(axis: int) -> np.ndarray:
    local = np.tile([0.01, 0.012, 0.013], (400, 1))
    local[:, axis] = np.linspace(0.001, 0.041, 400)
    return local


def test_bare_plastic_stays_smooth() -> None:
    color, normal = _looks(depth=0.0, translucency=0.0, local=_places(2))
    assert torch.allclose(color, torch.full_like(color, 0.4))
    assert torch.allclose(normal[:, 0], torch.ones(400))


def test_layers_tilt_normals_along_their_axis_only() -> None:
    _, across = _looks(depth=0.15, translucency=0.0, local=_places(2))
    _, along = _looks(depth=0.15, translucency=0.0, local=_places(1))
    assert float(across[:, 2].std()) > 0.03
    assert float(across[:, 1].abs().max()) < 1e-6
    assert float(along[:, 2].diff().abs().mean()) < 0.3 * float(across[:, 2].diff().abs().mean())


def test_a_line_follows_the_outline_of_printed_faces() -> None:
    inner, line, rim = (
        float(_looks(depth=0.2, translucency=0.0, local=_places(1), edge=edge)[0].mean())
        for edge in (0.0, 0.10, 0.5)
    )
    assert line < 0.98 * inner
    assert rim > 1.02 * inner


def test_fingers_are_redder_than_the_arm() -> None:
    near, far = _places(1), _places(1) - [0, 0.25, 0]
    fingers, _ = _looks(depth=0.0, translucency=0.35, local=near)
    arm, _ = _looks(depth=0.0, translucency=0.35, local=far)
    redness = [float((c[:, 0] / c[:, 2]).mean()) for c in (fingers, arm)]
    assert redness[0] > 1.2 * redness[1]


def test_skin_normals_stay_unit() -> None:
    _, normal = _looks(depth=0.0, translucency=0.35, local=_places(0))
    assert torch.allclose(normal.norm(dim=1), torch.ones(400), atol=1e-5)
    assert float(normal[:, 0].std()) > 1e-4


def test_nails_are_paler_than_skin_within_a_darker_fold() -> None:
    plate, fold, skin = (
        _looks(depth=0.0, translucency=0.35, local=_places(1), mark=mark)[0].mean(0)
        for mark in (0.8, -0.1, -3.0)
    )
    assert torch.all(plate > skin * 1.01)
    assert torch.all(fold < skin * 0.95)
    glove = [
        _looks(depth=0.0, translucency=0.0, local=_places(1), mark=mark)[0] for mark in (0.8, -3.0)
    ]
    assert torch.equal(*glove)


def test_arms_have_a_few_small_moles() -> None:
    along, around = np.meshgrid(np.arange(-0.56, -0.16, 0.0005), np.linspace(-3.0, 3.0, 300))
    finish = torch.zeros(along.size, COLUMNS)
    finish[:, :3], finish[:, 6], finish[:, 8] = 0.4, 0.0006, 0.35
    finish[:, 11], finish[:, 12] = 1.0, 1.0
    turned = torch.tensor(around.ravel(), dtype=torch.float32)
    normal = torch.stack([torch.cos(turned), torch.zeros_like(turned), torch.sin(turned)], 1)
    local = torch.zeros_like(normal)
    local[:, 1] = torch.tensor(along.ravel(), dtype=torch.float32)
    far, no_mark = torch.full_like(turned, 0.001), torch.full_like(turned, -3.0)
    color, _ = decorate(finish, local, normal, torch.zeros_like(turned), far, no_mark)
    green = color[:, 1].numpy().reshape(along.shape)
    dark = (green < 0.8 * np.median(green)).mean()
    assert 0.00005 < dark < 0.004
