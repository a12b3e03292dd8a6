"""The compiled loops behind `group_fit`: scenes put together, and what every cell says for one, summed."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel


@kernel
@no_type_check
def _part_at(ids, row, column):
    """The number there, -1 outside."""
    inside = 0 <= row < ids.shape[0] and 0 <= column < ids.shape[1]
    return ids[row, column] if inside else -1


@kernel
@no_type_check
def sum_spoken(cells, limits, move, nearer):
    """Sum over the cells of what each says for a scene; and the counts of `Said`.

    Args:
        cells: inverse depth and ids of the scene as drawn; number of the base, depth, ratios,
            ground and what is swallowed as measured.
        limits: sigma, most, least and hidden of the config.
        move: how the scene lies: cells to the right and down, radians.
        nearer: than drawn, metres.
    """
    inverse_depth, ids, base, depth, ratios, ground, swallowed = cells
    sigma, most, least, hidden = limits
    cos, sin = np.cos(move[2]), np.sin(move[2])
    height, width = depth.shape
    last = len(ratios) - 1
    total = 0.0
    counts = np.zeros(6, np.int64)
    middle_row, middle_column = 0.5 * (height - 1), 0.5 * (width - 1)
    for row in range(height):
        y = row - middle_row - move[1]
        for column in range(width):
            z = depth[row, column]
            if z <= 0.0:
                continue
            x = column - middle_column - move[0]
            c = int(np.floor(cos * x + sin * y + middle_column + 0.5))
            r = int(np.floor(cos * y - sin * x + middle_row + 0.5))
            i = _part_at(ids, r, c)
            is_group = i >= 0
            if is_group:
                surface = 1.0 / inverse_depth[r, c] - nearer
            elif ground[row, column] > 0.0:
                i, surface = last, 1.0 / ground[row, column]
            else:
                continue
            gap = (z - surface) / sigma
            counts[0] += is_group
            counts[3] += i == base
            if gap < -hidden:
                continue
            value = max(least, most - 0.5 * gap * gap + ratios[i, row, column])
            if value < 0.0 and swallowed[i, row, column]:
                continue
            total += value
            counts[1] += is_group
            counts[2] += is_group and value > 0.0
            counts[4] += i == base
            counts[5] += i == base and value > 0.0
    return total, counts


@kernel
@no_type_check
def climb(cells, limits, nearer, steps, rounds):
    """Move a scene uphill by steps (cells, radians), each taken so often at most.

    Returns the sum and counts of `sum_spoken` at the best move, and that.
    """
    best = np.zeros(3)
    total, counts = sum_spoken(cells, limits, best, nearer)
    for k in range(len(steps)):
        for _ in range(rounds):
            is_better = False
            for axis in range(3):
                step = steps[k, 1] if axis == 2 else steps[k, 0]
                if step == 0.0:
                    continue
                for sign in (1.0, -1.0):
                    move = best.copy()
                    move[axis] += sign * step
                    value, found = sum_spoken(cells, limits, move, nearer)
                    if value > total:
                        best, total, counts, is_better = move, value, found, True
                        break
            if not is_better:
                break
    return total, counts, best


@kernel
@no_type_check
def cover(inverse_depth, ids, other_inverse_depth, other_ids):
    """Draw another scene into the first one, in place, where it is nearer."""
    for row in range(ids.shape[0]):
        for column in range(ids.shape[1]):
            if other_inverse_depth[row, column] > inverse_depth[row, column]:
                inverse_depth[row, column] = other_inverse_depth[row, column]
                ids[row, column] = other_ids[row, column]
