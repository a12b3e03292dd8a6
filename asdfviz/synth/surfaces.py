"""Surface detail in torch: lines of printed plastic, and skin with its blotches, tendons, creases and hairs.

The G-buffer looks up what lies here at every pixel that shows a mesh. Everything is a function of the
place in the mesh's own frame, so that it moves with the mesh.
"""

from __future__ import annotations

import torch
from jaxtyping import Float32
from torch import Tensor

from asdfviz.synth.tensors import length, unit
from asdfviz.synth.textures import macro_map

COLUMNS = 15
"""Columns of a finish: colour 0-2, roughness 3, mottling 4, layer axis 5, layer height 6, layer depth
7, translucency 8, the layer axis and the next axis of the mesh in the world 9-11 and 12-14."""
SHEEN = (0.60, 0.44, 0.39)
"""Red, green and blue that printed layers add to any colour, by the layers' depth: warm, as rooms are
(fitted to blue and black prints in the paper's recordings)."""
MOST_SHINY = 0.03
"""Depth of the layers from which on they add no more."""
NAIL = (0.02, 0.10, 0.14)
"""By what share a nail is brighter in red, green and blue than the skin about it."""
FOLD = (0.10, 0.17, 0.18)
"""And the fold about it darker."""
MOLE = (0.45, 0.60, 0.62)
"""By what share a mole is darker than the skin about it."""
NOISE_DEVIATION = 0.03
"""How much the brightness of the map "plain" strays."""
_MOLE_SALT = ((12.9898, 78.233), (39.346, 11.135), (73.156, 52.235))


def decorate(
    finish: Float32[Tensor, "p 15"],
    local: Float32[Tensor, "p 3"],
    normal: Float32[Tensor, "p 3"],
    edge: Float32[Tensor, "p"],
    footprint: Float32[Tensor, "p"],
    mark: Float32[Tensor, "p"],
) -> tuple[Float32[Tensor, "p 3"], Float32[Tensor, "p 3"]]:
    """Colour and normal at points of meshes.

    Args:
        finish: see COLUMNS.
        local: places in the mesh's frame, metres.
        normal: smooth unit normals, world.
        edge: how near an edge of the shape is, 0 to 1.
        footprint: size of a pixel there, metres.
        mark: of skin: above 0 on a nail, 1 in its middle.
    """
    noise = (macro_map("plain", 0, str(local.device))[2] - 1) / NOISE_DEVIATION
    x, y, z = local.unbind(1)
    value = _at(noise, (x + 0.71 * z) / 0.25, (y + 0.53 * z - 0.31 * x) / 0.25)
    color = finish[:, :3] * (1 + 0.3 * value * finish[:, 4]).clamp(min=0.3)[:, None]
    color, normal = _printed(finish, local, normal, footprint, color, value, noise)
    # The outline of a layer is drawn round in its own lines; the one next to the fill stands out.
    outline = (edge / 0.1).clamp(max=1) - 1.8 * torch.exp(-(((edge - 0.10) / 0.05) ** 2))
    color = color * (1 + 0.30 * finish[:, 7] * outline)[:, None]
    skin = (finish[:, 8] > 0).nonzero()[:, 0]
    if len(skin) > 0:
        bare, normal[skin] = _skin(finish[skin], local[skin], normal[skin], color[skin], noise)
        color[skin] = _nails(bare, mark[skin])
    return color, normal


def _at(noise: Tensor, u: Tensor, v: Tensor) -> Tensor:
    """The noise at places counted in widths of its map, which repeats."""
    side = noise.shape[0]
    return noise[(v * side).long() % side, (u * side).long() % side]


def _printed(
    finish: Tensor,
    local: Tensor,
    normal: Tensor,
    footprint: Tensor,
    color: Tensor,
    value: Tensor,
    noise: Tensor,
) -> tuple[Tensor, Tensor]:
    """Streaks of the printer's lines: level faces show the diagonal lines that fill a layer, others
    the layers' edges. Lines tilt the normal, so that gloss breaks up along them.

    Single layers show only where a pixel can resolve them.
    """
    depth = finish[:, 7]
    along = local.gather(1, finish[:, 5:6].long())[:, 0]
    level = (normal * unit(finish[:, 9:12])).sum(1).abs() > 0.85
    line = torch.where(level, local.sum(1) - along, along)
    row = torch.full_like(line, 0.011)
    # Differences of neighbours: strands of one to three millimetres, no broad bands.
    streak = _at(noise, line / 0.03, row) - _at(noise, (line + 0.0015) / 0.03, row)
    streak = 1.1 * streak * (1 + 0.35 * value)
    shown = torch.where(level, 0.10, 0.16) * streak * depth
    # The strands' own gloss is broad, whatever the plastic's colour: violet on blue, brown on black.
    gloss = depth.clamp(max=MOST_SHINY) * (0.6 + torch.where(level, 0.2, 0.45) * streak).clamp(
        min=0
    )
    color = color * (1 + shown).clamp(min=0.3)[:, None] + gloss[:, None] * color.new_tensor(SHEEN)
    height = finish[:, 6]
    seen = (height / (2 * footprint) - 0.5).clamp(0, 1)
    ripple = torch.sin(along * (2 * torch.pi) / height) * seen * ~level
    across = torch.where(level[:, None], finish[:, 12:15], finish[:, 9:12])
    tilt = (ripple + torch.where(level, 0.2, 0.7) * streak) * depth
    return color, unit(normal + across * tilt[:, None])


def _skin(
    finish: Tensor, local: Tensor, normal: Tensor, color: Tensor, noise: Tensor
) -> tuple[Tensor, Tensor]:
    """Pink and tan blotches, redder fingers, tendons and veins along the arm, creases across the
    fingers, hairs and moles on the arm.

    The hand's frame: fingers along +y, its back along +z, the grasp point at the origin.
    """
    x, y, z = local.unbind(1)
    fingers = torch.exp(-((length(local)[:, 0] / 0.06) ** 2))
    arm = ((-y - 0.09) / 0.05).clamp(0, 1)
    around = x + 0.5 * z
    blotch = _at(noise, (x + 0.6 * z) / 0.3, (y - 0.5 * z) / 0.3)
    fine = _at(noise, (x - 0.7 * z) / 0.09, (y + 0.4 * x) / 0.09)
    red = (0.65 * fingers + 0.12 * blotch + 0.06 * fine)[:, None]
    hue = torch.tensor([0.04, -0.5, -0.62], device=color.device)
    color = color * (1 + red * hue).clamp(0.3, 1.3) * (1 + 0.05 * blotch + 0.045 * fine)[:, None]
    # A vein's height is the ridge of a stretched noise; its slope across the arm tilts the normal.
    ridge = [
        torch.exp(-((_at(noise, (around + s) / 0.16, y / 0.9 + 0.3 * x) * 1.6) ** 2))
        for s in (0.0, 0.0012)
    ]
    cord = (ridge[1] - ridge[0]) * (0.15 + 0.05 * arm)
    crease = [
        torch.exp(-((_at(noise, x / 0.25, (y + 0.4 * z + s) / 0.07) * 5) ** 2))
        for s in (0.0, 0.0008)
    ]
    fold = (crease[1] - crease[0]) * (1 - arm)
    # Differences of near neighbours keep the fine part of the noise: single hairs, no patches. They are
    # laid round the arm by where the skin looks: along a plane they would be stretched at its sides.
    round_arm = torch.atan2((normal * finish[:, 9:12]).sum(1), (normal * finish[:, 12:15]).sum(1))
    slant = (0.03 * round_arm + 0.4 * y) / 0.035
    hair = _at(noise, slant + 0.012, y / 0.11) - _at(noise, slant, y / 0.11)
    hair = ((hair.abs() - 0.25) * 6).clamp(0, 1)
    color = color * (1 - 0.05 * crease[0] * (1 - arm) - 0.06 * hair * arm)[:, None]
    color = color * (1 - 0.05 * ridge[0] * arm)[:, None]
    color = color * (1 - _moles(0.035 * round_arm, y)[:, None] * color.new_tensor(MOLE))
    # Bundles of short lines where the skin folds, brown rather than dark.
    bundle = (1.4 * _at(noise, x / 0.5 + 0.3, y / 0.16 + 0.4 * z) - 1.0).clamp(0, 1) * (1 - arm)
    phase = (y + 0.2 * x + 0.5 * z + 0.0024 * fine + 0.004 * blotch) * (2 * torch.pi / 0.0031)
    line = bundle * (0.5 + 0.5 * torch.cos(phase)).square().square()
    color = color * (1 - line[:, None] * color.new_tensor([0.05, 0.09, 0.11]))
    forward = _cross(finish[:, 9:12], finish[:, 12:15])
    uneven = (
        finish[:, 12:15] * (1.0 * cord + 0.05 * fine)[:, None]
        + forward * (0.09 * fold + 0.05 * blotch)[:, None]
    )
    return color, unit(normal + uneven * (finish[:, 8:9] / 0.35))


def _moles(u: Tensor, v: Tensor) -> Tensor:
    """How much of a mole lies here, 0 to 1: one of 1 to 2 mm in every sixth field of 4 cm."""
    cell_u, cell_v = torch.floor(u / 0.04), torch.floor(v / 0.04)
    throw = [torch.frac(torch.sin(cell_u * a + cell_v * b) * 43758.5).abs() for a, b in _MOLE_SALT]
    away_u = u - (cell_u + 0.1 + 0.8 * throw[0]) * 0.04
    away_v = v - (cell_v + 0.1 + 0.8 * throw[1]) * 0.04
    big = throw[2] - 5 / 6
    edge = (torch.sqrt(away_u**2 + away_v**2) - (0.0004 + 0.004 * big)) / 0.0009
    return (0.5 - edge).clamp(0, 1) * (0.4 + 0.6 * throw[0]) * (big > 0)


def _nails(color: Tensor, mark: Tensor) -> Tensor:
    """Paler, pinker plates within a darker fold."""
    plate = (mark / 0.25).clamp(0, 1)[:, None]
    fold = torch.exp(-(((mark + 0.12) / 0.2) ** 2))[:, None]
    color = color * (1 + plate * color.new_tensor(NAIL))
    return color * (1 - fold * color.new_tensor(FOLD))


def _cross(a: Float32[Tensor, "p 3"], b: Float32[Tensor, "p 3"]) -> Float32[Tensor, "p 3"]:
    """Vector product."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]
