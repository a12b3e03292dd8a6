"""Poses held to joints and symmetries, in compiled loops: a frame asks for a hundred of them.

`joints` says what they mean. Poses are 4 x 4, of which the last row is never read.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.geometry.jit import kernel

FREE, PRISMATIC, REVOLUTE, CYLINDRICAL, BALL = range(5)
"""What a joint is; `FREE` is none: the part is where it is or not."""
CLOSE = np.radians(5.0)
"""Rotations nearer than this are not compared with others that look the same."""


@kernel
@no_type_check
def _then(T_a_b, T_b_c):
    """T_a_c."""
    T = np.zeros((4, 4))
    T[3, 3] = 1.0
    for i in range(3):
        for j in range(4):
            for k in range(3):
                T[i, j] += T_a_b[i, k] * T_b_c[k, j]
        T[i, 3] += T_a_b[i, 3]
    return T


@kernel
@no_type_check
def _moved(T, point):
    moved = np.empty(3)
    for i in range(3):
        moved[i] = T[i, 0] * point[0] + T[i, 1] * point[1] + T[i, 2] * point[2] + T[i, 3]
    return moved


@kernel
@no_type_check
def _turn(axis, offset, angle):
    """By an angle about an axis of unit length through a point (Rodrigues)."""
    x, y, z = axis[0], axis[1], axis[2]
    sine, rest = np.sin(angle), 1.0 - np.cos(angle)
    T = np.zeros((4, 4))
    T[0, 0], T[0, 1] = 1.0 - rest * (y * y + z * z), rest * x * y - sine * z
    T[0, 2], T[1, 0] = rest * x * z + sine * y, rest * x * y + sine * z
    T[1, 1], T[1, 2] = 1.0 - rest * (x * x + z * z), rest * y * z - sine * x
    T[2, 0], T[2, 1] = rest * x * z - sine * y, rest * y * z + sine * x
    T[2, 2], T[3, 3] = 1.0 - rest * (x * x + y * y), 1.0
    turned = _moved(T, offset)
    for i in range(3):
        T[i, 3] = offset[i] - turned[i]
    return T


@kernel
@no_type_check
def _between(T_a, T_b):
    """R_a.T @ R_b."""
    R = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                R[i, j] += T_a[k, i] * T_b[k, j]
    return R


@kernel
@no_type_check
def _angle(T_a, T_b):
    """Between two rotations; exact near 0 and pi."""
    R = _between(T_a, T_b)
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    return np.arctan2(np.sqrt(x * x + y * y + z * z), R[0, 0] + R[1, 1] + R[2, 2] - 1.0)


@kernel
@no_type_check
def _twist(R, axis):
    """The turn about an axis that is nearest to a rotation, or to a sum of products of points."""
    along = 0.0
    for i in range(3):
        for j in range(3):
            along += axis[i] * R[i, j] * axis[j]
    sine = axis[0] * (R[2, 1] - R[1, 2]) + axis[1] * (R[0, 2] - R[2, 0])
    sine += axis[2] * (R[1, 0] - R[0, 1])
    return np.arctan2(sine, R[0, 0] + R[1, 1] + R[2, 2] - along)


@kernel
@no_type_check
def nearest_alike(T, T_reference, discrete, axes, middle):
    """Of the poses that look like T the one whose rotation is nearest to the reference's.

    Args:
        T: 4 x 4.
        T_reference: likewise.
        discrete: symmetries but the identity, (n, 4, 4).
        axes: direction and point of the continuous ones, (m, 2, 3).
        middle: of a ball, which looks the same in every rotation, (1, 3); (0, 3): the part is none.
    """
    if len(middle):
        T_alike, seen = T_reference.copy(), _moved(T, middle[0])
        there = _moved(T_reference, middle[0])
        for i in range(3):
            T_alike[i, 3] += seen[i] - there[i]
        return T_alike
    best, best_angle = T, np.inf
    for k in range(-1, len(discrete)):
        T_alike = T if k < 0 else _then(T, discrete[k])
        for axis in axes:
            angle = _twist(_between(T_alike, T_reference), axis[0])
            T_alike = _then(T_alike, _turn(axis[0], axis[1], angle))
        angle = _angle(T_alike, T_reference)
        if angle < best_angle - 1e-12:
            best, best_angle = T_alike, angle
    return best


@kernel
@no_type_check
def _ball_turn(motion, origin, turn):
    """The rotation about a point that is nearest to a sum of products of points, seen by placed (Horn
    1987), no farther than the range; without one as far as it likes."""
    S, N = motion.T, np.empty((4, 4))
    N[0, 0] = S[0, 0] + S[1, 1] + S[2, 2]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        N[0, i + 1] = N[i + 1, 0] = S[j, k] - S[k, j]
        N[i + 1, i + 1] = S[i, i] - S[j, j] - S[k, k]
        N[i + 1, j + 1] = N[j + 1, i + 1] = S[i, j] + S[j, i]
    q = np.linalg.eigh(N)[1][:, 3]
    if q[0] < 0.0:
        q = -q
    length = np.sqrt(q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    limit = max(abs(turn[0]), abs(turn[1]))
    if limit == 0.0:
        limit = np.pi
    angle = min(2.0 * np.arctan2(length, q[0]), limit)
    axis = q[1:] / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
    return _turn(axis, origin, angle)


@kernel
@no_type_check
def nearest_turn(R, axis, turn):
    """The turn about an axis, within its range, that is nearest to a rotation, whole turns aside."""
    low, high, angle = turn[0], turn[1], _twist(R, axis)
    if high - low >= 2.0 * np.pi:
        return angle
    best, best_gap = low, np.inf
    for turns in range(-3, 4):
        same = angle + 2.0 * np.pi * turns
        held = min(max(same, low), high)
        if abs(held - same) < best_gap:
            best, best_gap = held, abs(held - same)
    return best


@kernel
@no_type_check
def _motion(T, T_nominal, centre, spread, origin):
    """The sum of products of a part's points about a joint, seen by placed; its rotation alone where
    spread is below 0."""
    motion = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                motion[i, j] += T[i, k] * T_nominal[j, k]
    if spread >= 0.0:
        seen, placed = _moved(T, centre), _moved(T_nominal, centre)
        for i in range(3):
            for j in range(3):
                lever = (seen[i] - origin[i]) * (placed[j] - origin[j])
                motion[i, j] = spread * spread * motion[i, j] + lever
    return motion


@kernel
@no_type_check
def nearest_held(T, T_nominal, centre, spread, kind, axis, origin, turn, slide):
    """The pose nearest to T that a joint lets the nominal one reach; see `joints.nearest_in_joint`.

    Args:
        T: T_base_part.
        T_nominal: likewise.
        centre: of the part, in its frame.
        spread: of its points about that; below 0 it is turned as its rotation tells.
        kind: of the joint.
        axis: in the base part's frame.
        origin: likewise.
        turn: lower and upper end of its range.
        slide: likewise.
    """
    T_held = T_nominal.copy()
    if kind != PRISMATIC:
        motion = _motion(T, T_nominal, centre, spread, origin)
        if kind == BALL:
            T_held = _then(_ball_turn(motion, origin, turn), T_nominal)
        else:
            T_held = _then(_turn(axis, origin, nearest_turn(motion, axis, turn)), T_nominal)
    if kind in (PRISMATIC, CYLINDRICAL):
        seen, held, travel = _moved(T, centre), _moved(T_held, centre), 0.0
        for i in range(3):
            travel += (seen[i] - held[i]) * axis[i]
        travel = min(max(travel, slide[0]), slide[1])
        for i in range(3):
            T_held[i, 3] += travel * axis[i]
    return T_held


@kernel
@no_type_check
def _apart(T_a, T_b, centre):
    a, b = _moved(T_a, centre), _moved(T_b, centre)
    gap = np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    return gap, _angle(T_a, T_b)


@kernel
@no_type_check
def deviation(T, T_nominal, centre, spread, joint, alike):
    """Distance of the centres and angle between T and the nearest pose that looks and moves like the
    nominal one; see `joints.deviation`.

    Args:
        T: T_base_part.
        T_nominal: likewise.
        centre: of the part, in its frame.
        spread: as above.
        joint: kind, axis, origin, turn and slide, as above.
        alike: discrete, axes and middle, as above.
    """
    kind, axis, origin, turn, slide = joint
    discrete, axes, middle = alike
    T_near = nearest_alike(T, T_nominal, discrete, axes, middle)
    if kind == FREE:
        return _apart(T_near, T_nominal, centre)
    # The nearest to the nominal may be out of the joint's range, and another that looks the same in it.
    best, best_angle = np.inf, np.inf
    for k in range(-1, len(discrete)):
        T_equal = T_near if k < 0 else _then(T_near, discrete[k])
        T_held = nearest_held(T_equal, T_nominal, centre, spread, kind, axis, origin, turn, slide)
        T_same = nearest_alike(T, T_held, discrete, axes, middle)
        gap, angle = _apart(T_same, T_held, centre)
        if angle < best_angle:
            best, best_angle = gap, angle
        if angle < CLOSE or turn[0] == turn[1]:
            break
    return best, best_angle
