"""Which views of a viewpoint model a pose shows, and the points that they give together.

A pose lies between views. Taking points of the three around it, as many of each as it is near,
averages their errors out and lets 642 views do what M3T needs 2562 for.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np

from asdfviz.track.jit import kernel

VIEWS = 3


@kernel
@no_type_check
def _triple(a, b, c):
    """Determinant of three vectors."""
    return (
        a[0] * (b[1] * c[2] - b[2] * c[1])
        + a[1] * (b[2] * c[0] - b[0] * c[2])
        + a[2] * (b[0] * c[1] - b[1] * c[0])
    )


@kernel
@no_type_check
def _distance(a, b):
    """Length of a - b."""
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel
@no_type_check
def nearest_views(directions, T, views, shares):
    """Fill the indices (3,) of the views nearest to pose T (4,4) and their shares (3,), sum 1.

    The shares are the coordinates of the viewing direction in the three views' directions.
    """
    d = np.empty(3)
    for i in range(3):
        d[i] = T[0, i] * T[0, 3] + T[1, i] * T[1, 3] + T[2, i] * T[2, 3]
    best = np.full(VIEWS, -1e18)
    views[:] = 0
    for k in range(len(directions)):
        dot = directions[k, 0] * d[0] + directions[k, 1] * d[1] + directions[k, 2] * d[2]
        if dot <= best[2]:
            continue
        place = 2
        while place > 0 and dot > best[place - 1]:
            best[place], views[place] = best[place - 1], views[place - 1]
            place -= 1
        best[place], views[place] = dot, k
    a, b, c = directions[views[0]], directions[views[1]], directions[views[2]]
    volume = _triple(a, b, c)
    # Views in one line, on both sides of the nearest, say nothing of the direction across it.
    if abs(volume) < 0.2 * _distance(a, b) * _distance(a, c):
        shares[0], shares[1], shares[2] = 1.0, 0.0, 0.0
        return
    shares[0] = max(_triple(d, b, c) / volume, 0.0)
    shares[1] = max(_triple(a, d, c) / volume, 0.0)
    shares[2] = max(_triple(a, b, d) / volume, 0.0)
    total = shares[0] + shares[1] + shares[2]
    for i in range(VIEWS):
        shares[i] /= total


@kernel
@no_type_check
def gather(points, offsets, column, sizes, views, shares, most, adaptive, out, out_offsets):
    """Collect points of the views by their shares; return how many.

    `sizes` is the contour length or the area by view; where 0, the view has no points. `most`
    points are wanted in all, fewer if `adaptive`, in proportion to the size.
    """
    mean, greatest = 0.0, 1e-12
    for i in range(VIEWS):
        mean += shares[i] * sizes[views[i]]
    for k in range(len(sizes)):
        greatest = max(greatest, sizes[k])
    wanted = int(most * mean / greatest) if adaptive else most
    filled, so_far = 0, 0.0
    for i in range(VIEWS):
        so_far += shares[i]
        if sizes[views[i]] <= 0.0:
            continue
        upto = min(wanted, int(wanted * so_far + 0.5))
        k = 0
        while filled < upto and k < points.shape[1]:
            for a in range(out.shape[1]):  # a row at once would take seconds more to compile
                out[filled, a] = points[views[i], k, a]
            out_offsets[filled] = offsets[views[i], k, column]
            filled += 1
            k += 1
    return filled
