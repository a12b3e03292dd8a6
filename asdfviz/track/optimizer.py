"""Newton's step with Tikhonov's regularisation, for one part or for parts that hang together.

A group is a root part with six freedoms and parts that are fixed to it or move in joints. The
poses here are of the parts' centres (see `ViewpointModel`); a variation theta = (rotation,
translation) acts on the part's side, T <- T * [Exp(theta_r) | theta_t]. Equations of Stoiber et
al., "A Multi-body Tracking Framework" (2022): a root variation theta_0 moves a fixed part by
Ad(T_part_root) theta_0, and a joint with screw s and freedom q by Ad(T_part_root) s q. Joints that are
geared together have one q.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float64, Int64

from asdfviz.geometry.cholesky import solve
from asdfviz.geometry.shapes import Transforms
from asdfviz.track.jit import kernel
from asdfviz.track.links import Freedom, Link, gear


@dataclass(frozen=True, slots=True)
class OptimizerConfig:
    """Regularisation; defaults are ICG's (Stoiber et al., CVPR 2022)."""

    rotation: float = 1000.0
    """Added to the Hessian for each rotation, 1 / rad^2."""
    translation: float = 30000.0
    """Added to the Hessian for each translation, 1 / m^2."""


class Group:
    """A root part and what hangs on it; `members` are places in the tracker's list of parts."""

    def __init__(self, root: int, links: Sequence[Link], config: OptimizerConfig) -> None:
        self.members: tuple[int, ...] = (root, *(link.member for link in links))
        self._links = tuple(links)
        gear(self._links)
        self._Ts_root_member: Transforms = np.stack([np.eye(4), *(k.T_root_member for k in links)])
        free = [(place, one) for place, link in enumerate(links, 1) for one in link.freedoms]
        self._owners = np.array([place for place, _ in free], np.int64)
        self._columns = _columns([one for _, one in free])
        self._screws: Float64[np.ndarray, "d 6"] = np.array(
            [one.screw for _, one in free], np.float64
        ).reshape(-1, 6)
        self._regularisation = np.zeros(6 + int(self._columns.max(initial=-1)) + 1)
        self._regularisation[:3], self._regularisation[3:6] = config.rotation, config.translation
        for column, (_, one) in zip(self._columns, free, strict=True):
            strength = config.rotation * one.turn**2 + config.translation * one.slide**2
            self._regularisation[6 + column] += strength
        size = len(self._regularisation)
        self._A, self._theta = np.zeros((size, size)), np.zeros(size)

    def step(
        self,
        Ts_camera_centre: Transforms,
        gradients: Float64[np.ndarray, "p 6"],
        hessians: Float64[np.ndarray, "p 6 6"],
    ) -> bool:
        """Move the group's poses, in place, by one Newton step.

        Args:
            Ts_camera_centre: of all the tracker's parts.
            gradients: of the members, in their order.
            hessians: lower halves of the negative Hessians, likewise.

        Returns:
            False where the step is no number and nothing was moved.
        """
        root = self.members[0]
        solved = newton_step(
            gradients,
            hessians,
            self._Ts_root_member,
            self._owners,
            self._columns,
            self._screws,
            self._regularisation,
            self._A,
            self._theta,
        )
        if not solved:
            return False
        move(Ts_camera_centre[root], self._theta)
        for place, link in enumerate(self._links, 1):
            own = self._columns[self._owners == place]
            if len(own):
                link.move(self._theta[6 + own])
                self._Ts_root_member[place] = link.T_root_member
        self.place(Ts_camera_centre)
        return True

    def place(self, Ts_camera_centre: Transforms) -> None:
        """Put the linked parts, in place, where the root has them."""
        root = self.members[0]
        for place, member in enumerate(self.members[1:], 1):
            np.dot(
                Ts_camera_centre[root], self._Ts_root_member[place], out=Ts_camera_centre[member]
            )


def _columns(free: Sequence[Freedom]) -> Int64[np.ndarray, "d"]:
    """The place of every freedom among the numbers that are sought: one for all of a link."""
    known: dict[object, int] = {}
    keys = (one.shared or place for place, one in enumerate(free))
    return np.array([known.setdefault(key, len(known)) for key in keys], np.int64)


@kernel
@no_type_check
def move(T, theta):
    """T <- T * [Exp(theta_r) | theta_t], in place, kept orthonormal to first order."""
    x, y, z = theta[0], theta[1], theta[2]
    square = x * x + y * y + z * z
    angle = np.sqrt(square)
    a = np.sin(angle) / angle if angle > 1e-6 else 1.0 - square / 6.0
    b = (1.0 - np.cos(angle)) / square if angle > 1e-6 else 0.5
    D = np.empty((3, 3))
    D[0, 0], D[1, 1], D[2, 2] = (
        1 - b * (y * y + z * z),
        1 - b * (x * x + z * z),
        1 - b * (x * x + y * y),
    )
    D[0, 1], D[1, 0] = b * x * y - a * z, b * x * y + a * z
    D[0, 2], D[2, 0] = b * x * z + a * y, b * x * z - a * y
    D[1, 2], D[2, 1] = b * y * z - a * x, b * y * z + a * x
    for i in range(3):
        r0, r1, r2 = T[i, 0], T[i, 1], T[i, 2]
        T[i, 3] += r0 * theta[3] + r1 * theta[4] + r2 * theta[5]
        for j in range(3):
            T[i, j] = r0 * D[0, j] + r1 * D[1, j] + r2 * D[2, j]
    # One Newton step towards R^T R = 1 undoes the rounding of thousands of products.
    for i in range(3):
        for j in range(3):
            D[i, j] = T[0, i] * T[0, j] + T[1, i] * T[1, j] + T[2, i] * T[2, j]
    for i in range(3):
        r0, r1, r2 = T[i, 0], T[i, 1], T[i, 2]
        for j in range(3):
            T[i, j] = 1.5 * T[i, j] - 0.5 * (r0 * D[0, j] + r1 * D[1, j] + r2 * D[2, j])


@kernel
@no_type_check
def adjoint(T, out):
    """Fill Ad(T^-1) (6,6): a variation in the root's axes, seen from a part at T_root_part."""
    for i in range(3):
        for j in range(3):
            out[i, j] = T[j, i]
            out[3 + i, 3 + j] = T[j, i]
            out[i, 3 + j] = 0.0
    x, y, z = T[0, 3], T[1, 3], T[2, 3]
    # R^T (theta x t + theta_t): the point's own motion, so the lower left block is -R^T [t]x.
    for i in range(3):
        out[3 + i, 0] = -(T[1, i] * z - T[2, i] * y)
        out[3 + i, 1] = -(T[2, i] * x - T[0, i] * z)
        out[3 + i, 2] = -(T[0, i] * y - T[1, i] * x)


@kernel
@no_type_check
def jacobian(T_root_member, place, owners, columns, screws, J):
    """Fill J (6,n) = Ad(T_member_root) [1 | the member's own screws, 0 for those of others].

    `columns` (d,) says which number moves each of the screws (d,6), `owners` (d,) whose it is.
    """
    Ad = np.empty((6, 6))
    adjoint(T_root_member, Ad)
    for i in range(6):
        for c in range(6):
            J[i, c] = Ad[i, c]
        for c in range(6, J.shape[1]):
            J[i, c] = 0.0
        for d in range(len(owners)):
            if owners[d] == place:
                for k in range(6):
                    J[i, 6 + columns[d]] += Ad[i, k] * screws[d, k]


@kernel
@no_type_check
def add_member(gradient, hessian, J, A, b):
    """A += J^T H J and b += J^T g, with the lower halves of H and A alone."""
    n = J.shape[1]
    column = np.empty(6)
    for c in range(n):
        for i in range(6):
            column[i] = 0.0
            for k in range(6):
                column[i] += hessian[max(i, k), min(i, k)] * J[k, c]
        for i in range(6):
            b[c] += J[i, c] * gradient[i]
            for r in range(c, n):
                A[r, c] += J[i, r] * column[i]


@kernel
@no_type_check
def newton_step(
    gradients, hessians, Ts_root_member, owners, columns, screws, regularisation, A, theta
):
    """Fill theta from (sum J^T H J + regularisation) theta = sum J^T g; False if it has none.

    A is working space; `owners`, `columns` and `screws` are as for `jacobian`.
    """
    n = len(regularisation)
    J, b = np.zeros((6, n)), np.zeros(n)
    for r in range(n):
        for c in range(n):
            A[r, c] = regularisation[r] if r == c else 0.0
    for p in range(len(gradients)):
        jacobian(Ts_root_member[p], p, owners, columns, screws, J)
        add_member(gradients[p], hessians[p], J, A, b)
    return solve(A, b, theta)
