"""The compiled loops behind `drawn_looks`: a pose laid over what lies behind it, how far depth is from that,
and how much of the brightness shading by normals leaves unexplained."""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.cholesky import solve
from asdfviz.geometry.jit import kernel

RIDGE = 0.01
"""Holds the factors of normals that hardly differ near zero."""
LEAST_INSIDE = 0.2
"""Of a smoothed normal: beside the part's rim its length says little."""
LEAST_SPREAD = 1e-3
"""Of what is left, logarithm of brightness."""
ROBUST = 1.4826
"""Median of absolute deviations to a standard deviation."""


@kernel
@no_type_check
def _gathered(smooth, counted, brightness):
    """Terms (1 and the normal) and brightness of the pixels that count."""
    rows, columns = counted.nonzero()
    terms, bright = np.ones((len(rows), 4)), np.empty(len(rows))
    for i in range(len(rows)):
        pixel = smooth[rows[i], columns[i]]
        for k in range(3):
            terms[i, k + 1] = pixel[k] / max(pixel[3], LEAST_INSIDE)
        bright[i] = brightness[rows[i], columns[i]]
    return terms, bright


@kernel
@no_type_check
def _factors(terms, bright, weight):
    """Weighted least squares of the brightness by its terms."""
    A, y = RIDGE * np.eye(4), np.zeros(4)
    for i in range(len(bright)):
        for a in range(4):
            weighted = weight[i] * terms[i, a]
            y[a] += weighted * bright[i]
            for b in range(4):
                A[a, b] += weighted * terms[i, b]
    factors = np.zeros(4)
    solve(A, y, factors)  # positive definite, by the ridge
    return factors


@kernel
@no_type_check
def uneven(smooth, counted, brightness, rounds, largest):
    """What a linear function of the normal leaves of the brightness' logarithm, root mean square.

    Args:
        smooth: h w 4, smoothed sums of normals, and of ones, over the part's pixels.
        counted: h w, pixels that count.
        brightness: h w, logarithm.
        rounds: in which what does not fit comes to count less.
        largest: what is left counts for no more than this.
    """
    terms, bright = _gathered(smooth, counted, brightness)
    weight, left = np.ones(len(bright)), bright.copy()
    for _ in range(rounds):
        factors = _factors(terms, bright, weight)
        for i in range(len(bright)):
            left[i] = bright[i]
            for a in range(4):
                left[i] -= terms[i, a] * factors[a]
        spread = ROBUST * np.median(np.abs(left)) + LEAST_SPREAD
        for i in range(len(bright)):
            weight[i] = 1.0 / (1.0 + (left[i] / (2 * spread)) ** 2)
    total = 0.0
    for i in range(len(bright)):
        total += min(left[i] ** 2, largest**2)
    return np.sqrt(total / len(bright))


@kernel
@no_type_check
def laid_over(z, bare, depth, hidden_by):
    """Depth of the part and of what is there without it elsewhere, where something measured hides that,
    where the part shows, and in how many pixels.

    Args:
        z: h w, depth of the part, inf where it is not.
        bare: h w, what is there without it.
        depth: h w, measured, 0 = none.
        hidden_by: what is measured nearer than by this hides, metres.
    """
    height, width = z.shape
    surface, hidden = np.empty((height, width)), np.zeros((height, width), np.bool_)
    seen, count = np.zeros((height, width), np.bool_), 0
    for row in range(height):
        for column in range(width):
            is_part = np.isfinite(z[row, column])
            behind = z[row, column] if is_part else bare[row, column]
            measured = depth[row, column]
            surface[row, column] = behind
            hidden[row, column] = measured > 0.0 and measured < behind - hidden_by
            seen[row, column] = is_part and not hidden[row, column]
            count += seen[row, column]
    return surface, hidden, seen, count


@kernel
@no_type_check
def mean_gap(smeared, depth, rim, hidden, most, if_hidden):
    """Mean distance between smeared depth and the measured one over the rim's readings, metres, and how
    many of them nothing hides.

    Args:
        smeared: h w, drawn.
        depth: h w, measured, 0 = none.
        rim: h w, pixels that count.
        hidden: h w, where something nearer is measured,
        most: what is farther off counts for this, metres,
        if_hidden: and what is hidden for this.
    """
    total, count, clear = 0.0, 0, 0
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if not rim[row, column] or depth[row, column] <= 0.0:
                continue
            count += 1
            if hidden[row, column]:
                total += if_hidden
                continue
            clear += 1
            total += min(abs(smeared[row, column] - depth[row, column]), most)
    return total / max(count, 1), clear


@kernel
@no_type_check
def normals_shown(ids, seen, normals, offsets, T):
    """Unit normals in camera axes, turned towards the camera, and ones; 0 where nothing is seen.

    Args:
        ids: h w, the face that shows.
        seen: h w, where it does.
        normals: f 3, of the faces, part axes.
        offsets: f, of their planes from the part's origin along them.
        T: T_camera_part.
    """
    shown = np.zeros((*seen.shape, 4), np.float32)
    eye = np.zeros(3)
    for i in range(3):
        for j in range(3):
            eye[i] -= T[j, i] * T[j, 3]
    for row in range(seen.shape[0]):
        for column in range(seen.shape[1]):
            if not seen[row, column]:
                continue
            n = normals[ids[row, column]]
            towards = n[0] * eye[0] + n[1] * eye[1] + n[2] * eye[2] >= offsets[ids[row, column]]
            sign = 1.0 if towards else -1.0
            for i in range(3):
                turned = T[i, 0] * n[0] + T[i, 1] * n[1] + T[i, 2] * n[2]
                shown[row, column, i] = sign * turned
            shown[row, column, 3] = 1.0
    return shown
