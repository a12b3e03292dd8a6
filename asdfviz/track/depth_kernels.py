"""Inner loops of the depth modality: nearest measured points, point-to-plane derivatives.

Equations of Stoiber et al., "Iterative Corresponding Geometry" (CVPR 2022), sec. 3.3. A match has
MATCH_COLUMNS numbers: the model point (3), its normal (3), the measured point in camera axes (3).
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.track.jit import kernel
from asdfviz.track.visibility import id_at, occluded

MATCH_COLUMNS = 9


@kernel
@no_type_check
def nearest_point(depth, lens, x, y, z, distance, stride_length, out):
    """Fill the measured point nearest to (x, y, z) within `distance` metres; False if none."""
    height, width = depth.shape
    u, v = lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]
    if u < -0.5 or v < -0.5 or u > width - 0.5 or v > height - 0.5:
        return False
    diameter = 2.0 * distance * lens[0] / z
    stride = int(diameter / max(1, int(distance / stride_length + 0.5)) + 1.0)
    reach = int(diameter / (2 * stride))
    c_u, c_v = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
    u_from = c_u - min(reach, c_u // stride) * stride
    v_from = c_v - min(reach, c_v // stride) * stride
    u_to, v_to = min(c_u + reach * stride, width - 1), min(c_v + reach * stride, height - 1)
    best = distance * distance
    found = False
    for j in range(v_from, v_to + 1, stride):
        ray_y = (j - lens[3]) / lens[1]
        for i in range(u_from, u_to + 1, stride):
            d = depth[j, i]
            if d <= 0.0 or abs(d - z) >= distance:
                continue
            q_x, q_y = (i - lens[2]) * d / lens[0], ray_y * d
            square = (q_x - x) ** 2 + (q_y - y) ** 2 + (d - z) ** 2
            if square < best:
                best = square
                out[0], out[1], out[2] = q_x, q_y, d
                found = True
    return found


@kernel
@no_type_check
def find_matches(
    depth, points, count, T, lens, search, scale_by_depth, least_edge,
    hide, offsets, occlusion, ids, crop, own, matches,
):  # fmt: skip
    """Match the first `count` surface points to measured points; return how many found one.

    `search` is (considered distance, stride) in metres, both times z if `scale_by_depth`. Points that
    are nearer to the outline than `least_edge` pixels are left out. `hide`
    asks for the test of measured occlusion, (radius, threshold) in metres; an empty id image
    switches the test of other parts off.
    """
    found = 0
    for k in range(count):
        p = points[k]
        x = T[0, 0] * p[0] + T[0, 1] * p[1] + T[0, 2] * p[2] + T[0, 3]
        y = T[1, 0] * p[0] + T[1, 1] * p[1] + T[1, 2] * p[2] + T[1, 3]
        z = T[2, 0] * p[0] + T[2, 1] * p[1] + T[2, 2] * p[2] + T[2, 3]
        if z <= 0.0:
            continue
        if p[6] * lens[0] < least_edge * z:
            continue
        u, v = lens[0] * x / z + lens[2], lens[1] * y / z + lens[3]
        if ids.size > 0 and id_at(ids, crop, u, v) != own:
            continue
        if hide:
            limit = z - offsets[k] - occlusion[1]
            if occluded(depth, u, v, limit, occlusion[0] * lens[0] / z):
                continue
        scale = z if scale_by_depth else 1.0
        match = matches[found]
        if nearest_point(depth, lens, x, y, z, search[0] * scale, search[1] * scale, match[6:9]):
            for i in range(6):
                match[i] = p[i]
            found += 1
    return found


@kernel
@no_type_check
def plane_distance(match, T, jacobian):
    """Return N . (X - Q) in part axes (metres), and its derivative (Q x N, N) by the pose.

    The derivative is by (rotation, translation) in the part's axes: T <- T * exp(theta).
    """
    x, y, z = match[6] - T[0, 3], match[7] - T[1, 3], match[8] - T[2, 3]
    q_x = T[0, 0] * x + T[1, 0] * y + T[2, 0] * z
    q_y = T[0, 1] * x + T[1, 1] * y + T[2, 1] * z
    q_z = T[0, 2] * x + T[1, 2] * y + T[2, 2] * z
    n_x, n_y, n_z = match[3], match[4], match[5]
    jacobian[0] = q_y * n_z - q_z * n_y
    jacobian[1] = q_z * n_x - q_x * n_z
    jacobian[2] = q_x * n_y - q_y * n_x
    jacobian[3], jacobian[4], jacobian[5] = n_x, n_y, n_z
    return n_x * (match[0] - q_x) + n_y * (match[1] - q_y) + n_z * (match[2] - q_z)


@kernel
@no_type_check
def add_matches(matches, count, T, sigma, gradient, hessian):
    """Add all matches to gradient (6,) and to the negative of the Hessian (6,6).

    A match weighs 1 / (sigma z)^2 with z its measured depth.
    """
    jacobian = np.empty(6)
    for k in range(count):
        distance = plane_distance(matches[k], T, jacobian)
        weight = 1.0 / (sigma * matches[k, 8]) ** 2
        for i in range(6):
            gradient[i] -= weight * distance * jacobian[i]
            for j in range(i + 1):
                hessian[i, j] += weight * jacobian[i] * jacobian[j]
