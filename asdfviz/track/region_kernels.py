"""Inner loops of the region modality: correspondence lines, their derivatives, colour counts.

Equations of Stoiber et al., "SRT3D" (IJCV 2022), sec. 3, with the weight of ICG (CVPR 2022).
A line has LINE_COLUMNS numbers: the model point (3), the pixel it was projected to (2), the unit
normal in the image (2), delta_r (px), nbar (segments a pixel), mean and variance (segments).
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.track.jit import kernel
from asdfviz.track.visibility import id_at, occluded

LINE_COLUMNS = 11
MAX_SEGMENTS = 64
CHECKS = 6
"""Probes of the id image on each side of a contour."""


@kernel
@no_type_check
def place(point, T, lens, out):
    """Project a contour point: fill u, v, z, n_u, n_v; False where it has no place in the image."""
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2] + T[0, 3]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2] + T[1, 3]
    z = T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2] + T[2, 3]
    n_x = T[0, 0] * point[3] + T[0, 1] * point[4] + T[0, 2] * point[5]
    n_y = T[1, 0] * point[3] + T[1, 1] * point[4] + T[1, 2] * point[5]
    length = np.sqrt(n_x * n_x + n_y * n_y)
    if z <= 0.0 or length < 1e-6:
        return False
    out[0] = lens[0] * x / z + lens[2]
    out[1] = lens[1] * y / z + lens[3]
    out[2] = z
    out[3] = n_x / length
    out[4] = n_y / length
    return True


@kernel
@no_type_check
def outline_is_open(ids, crop, own, at, reach_px):
    """Whether the id image shows the part inside of a contour place and not outside of it."""
    start = 2.0 / crop[2]
    for k in range(CHECKS):
        distance = start + k * max(reach_px - start, 0.0) / (CHECKS - 1)
        d_u, d_v = distance * at[3], distance * at[4]
        if id_at(ids, crop, at[0] - d_u, at[1] - d_v) != own:
            return False
        if id_at(ids, crop, at[0] + d_u, at[1] + d_v) == own:
            return False
    return True


@kernel
@no_type_check
def posterior(image, table, bits, u, v):
    """Probability of foreground for the colour of a pixel."""
    s = 8 - bits
    r, g, b = image[v, u, 0] >> s, image[v, u, 1] >> s, image[v, u, 2] >> s
    return table[(((r << bits) + g) << bits) + b]


@kernel
@no_type_check
def segments(image, table, bits, at, scale, count, foreground):
    """Fill the foreground probability of each segment, inside first.

    Returns:
        delta_r, the pixels along the normal from the model point to the middle of the line, whose
        pixels are whole; NaN where the line leaves the image.
    """
    height, width = image.shape[0], image.shape[1]
    steep = abs(at[4]) > abs(at[3])
    main, cross = (at[1], at[0]) if steep else (at[0], at[1])
    n_main, n_cross = (at[4], at[3]) if steep else (at[3], at[4])
    size_main, size_cross = (height, width) if steep else (width, height)
    length = count * scale
    half = (length - 1) / 2.0
    first = int(np.floor(main - half + 0.5))
    slope = n_cross / n_main
    ends = cross + (first - main) * slope, cross + (first + length - 1 - main) * slope
    if first < 0 or first + length > size_main:
        return np.nan
    if min(ends[0], ends[1]) < -0.5 or max(ends[0], ends[1]) >= size_cross - 0.5:
        return np.nan
    a = first if n_main > 0.0 else first + length - 1
    step = 1 if n_main > 0.0 else -1
    for k in range(count):
        f, b = 1.0, 1.0
        for _ in range(scale):
            c = int(np.floor(cross + (a - main) * slope + 0.5))
            p = (
                posterior(image, table, bits, c, a)
                if steep
                else posterior(image, table, bits, a, c)
            )
            f *= p
            b *= 1.0 - p
            a += step
        foreground[k] = f / (f + b) if f + b > 0.0 else 0.5
    return (first + half - main) / n_main


@kernel
@no_type_check
def distribution(foreground, step, probabilities):
    """Fill p(d) over contour offsets and return its mean and variance, in segments.

    p(d_j) is proportional to the product over i of pf(j+i) h_f(i) + pb(j+i) h_b(i).
    """
    n = len(probabilities)
    total = 0.0
    for j in range(n):
        product = 1.0
        for i in range(len(step)):
            product *= 1.0 - step[i] + foreground[j + i] * (2.0 * step[i] - 1.0)
        probabilities[j] = product
        total += product
    mean, square = 0.0, 0.0
    for j in range(n):
        probabilities[j] /= total
        d = j - (n - 1) / 2.0
        mean += probabilities[j] * d
        square += probabilities[j] * d * d
    return mean, square - mean * mean


@kernel
@no_type_check
def find_lines(
    image, table, bits, points, count, T, lens, scale, shape, step,
    depth, offsets, occlusion, ids, crop, own, lines, probabilities,
):  # fmt: skip
    """Place correspondence lines for the first `count` contour points; return how many hold.

    `shape` is (least continuous distance, least variance) in segments, `occlusion` (radius,
    threshold) in metres; an empty depth or id image switches its test off.
    """
    found = 0
    at = np.empty(5)
    foreground = np.empty(MAX_SEGMENTS)
    total = len(step) + probabilities.shape[1] - 1
    for k in range(count):
        point = points[k]
        if not place(point, T, lens, at):
            continue
        per_metre = lens[0] / at[2]
        if min(point[6], point[7]) * per_metre < shape[0] * scale:
            continue
        if depth.size > 0:
            limit = at[2] - offsets[k] - occlusion[1]
            if occluded(depth, at[0], at[1], limit, occlusion[0] * per_metre):
                continue
        if ids.size > 0 and not outline_is_open(ids, crop, own, at, shape[0] * scale):
            continue
        delta_r = segments(image, table, bits, at, scale, total, foreground)
        if np.isnan(delta_r):
            continue
        mean, variance = distribution(foreground, step, probabilities[found])
        line = lines[found]
        line[0], line[1], line[2] = point[0], point[1], point[2]
        line[3], line[4], line[5], line[6] = at[0], at[1], at[3], at[4]
        line[7] = delta_r
        line[8] = max(abs(at[3]), abs(at[4])) / scale
        line[9] = mean
        line[10] = max(variance, shape[1])
        found += 1
    return found


@kernel
@no_type_check
def line_offset(line, T, lens, jacobian):
    """Return delta_cs, the contour's offset from the line's middle in segments, and its derivative.

    The derivative is by (rotation, translation) in the part's axes: T <- T * exp(theta).
    """
    x = T[0, 0] * line[0] + T[0, 1] * line[1] + T[0, 2] * line[2] + T[0, 3]
    y = T[1, 0] * line[0] + T[1, 1] * line[1] + T[1, 2] * line[2] + T[1, 3]
    z = T[2, 0] * line[0] + T[2, 1] * line[1] + T[2, 2] * line[2] + T[2, 3]
    u, v = lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]
    delta = ((u - line[3]) * line[5] + (v - line[4]) * line[6] - line[7]) * line[8]
    a = line[8] * line[5] * lens[0] / z
    b = line[8] * line[6] * lens[1] / z
    c = -(a * x + b * y) / z
    for i in range(3):
        jacobian[3 + i] = T[0, i] * a + T[1, i] * b + T[2, i] * c
    jacobian[0] = line[1] * jacobian[5] - line[2] * jacobian[4]
    jacobian[1] = line[2] * jacobian[3] - line[0] * jacobian[5]
    jacobian[2] = line[0] * jacobian[4] - line[1] * jacobian[3]
    return delta


@kernel
@no_type_check
def slope_of(line, probabilities, delta, local_rate):
    """Derivative of log p at `delta`: of the normal distribution, or of its neighbours if local.

    A `local_rate` of 0 asks for the global step; NaN where the contour is off the line.
    """
    if local_rate == 0.0:
        return (line[9] - delta) / line[10]
    n = len(probabilities)
    upper = int(np.floor(delta + (n + 1) / 2.0))
    if upper <= 0 or upper >= n:
        return np.nan
    lower, higher = max(probabilities[upper - 1], 1e-30), max(probabilities[upper], 1e-30)
    return np.log(higher / lower) * local_rate / line[10]


@kernel
@no_type_check
def add_lines(lines, probabilities, count, T, lens, variance_px, local_rate, gradient, hessian):
    """Add all lines to gradient (6,) and to the negative of the Hessian (6,6).

    `variance_px` is (least variance in segments, sigma in px), giving the weight s / (nbar sigma)^2.
    """
    jacobian = np.empty(6)
    for k in range(count):
        line = lines[k]
        delta = line_offset(line, T, lens, jacobian)
        slope = slope_of(line, probabilities[k], delta, local_rate)
        if np.isnan(slope):
            continue
        weight = variance_px[0] / (line[8] * variance_px[1]) ** 2
        for i in range(6):
            gradient[i] += weight * slope * jacobian[i]
            for j in range(i + 1):
                hessian[i, j] += weight / line[10] * jacobian[i] * jacobian[j]
