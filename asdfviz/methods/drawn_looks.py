"""How a part would look in several poses, drawn and compared with the picture: its depth and its shading.

Not in the paper. At single points of its surface a small part agrees with depth about as well end for
end, and often better: a depth camera mixes near and far at every edge, which fills holes and rounds what
stands out. Drawn over the table and smeared like the camera does, the right pose agrees best. And a
surface is the brighter the more it faces the light: what it reflects is nearly a linear function of its
normal, whatever the light is, in the right pose alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int32

from asdfviz.datatypes import Frame, Mesh
from asdfviz.errors import MethodError
from asdfviz.geometry.boxes import box_around
from asdfviz.geometry.shapes import Intrinsics, Mask, Transform, Transforms
from asdfviz.methods.drawn_colors import divided_so
from asdfviz.methods.drawn_kernels import laid_over, mean_gap, normals_shown, uneven
from asdfviz.methods.drawn_smear import Plane, Smear
from asdfviz.methods.group_views import grown
from asdfviz.methods.registration import projected_box, window
from asdfviz.methods.seen_colors import log_colors
from asdfviz.pose.table import Table
from asdfviz.track import raster
from asdfviz.track.confidence import HIDDEN_BY
from asdfviz.track.viewpoint_model import face_planes

Placed: TypeAlias = tuple[Mesh, Transform]
"""A part's mesh and its pose T_camera_part."""

EDGE = 8
"""Pixels around the poses that are looked at too."""
RIM = 2
"""Pixels beside the outline in which the smear is compared;"""
BESIDE = 3
"""what is measured farther from it is taken as it is."""
LEAST = 10
"""Fewer pixels tell nothing."""
COVERED = 0.1
"""A trail may lie in front of so much of what stands up; where more is hidden, something else does."""
LARGEST_GAP = 0.01
"""Depth that is farther off than this counts as this far, metres;"""
HIDDEN = 0.008
"""and something nearer, which a pose says nothing of, for this much, or one that has the part in a hand's
place would be the better the less of the part it explains."""
LARGEST_UNEVEN = 0.5
"""the same for the logarithm of brightness."""
ROUNDS = 3
"""In which glints and prints are found, to count less."""


@dataclass(frozen=True)
class DrawnConfig:
    """How poses of one part are compared by how they would look.

    The weights are a logistic fit of the right poses against others in which a tracker settled the same
    part: 3,800 pairs of seven rendered sequences, in other sixteen of which they tell 91 % apart frame by
    frame where the tracker was right (depth at single points with contours: 82 %), and 69 % where it was
    wrong (38 %). One unit is what sixteen of log-odds are.
    """

    enabled: bool = True
    """On or off: if off, depth at single points of the surface and the contour are compared."""
    depth: float = 180.0
    """Weight of the mean gap between drawn and measured depth, per metre,"""
    shade: float = 2.1
    """and of what shading by normals does not explain of the brightness' logarithm."""
    outline: float = 0.1
    """Weight of the mean log-odds with which colours are those of the part where it is drawn, and of what
    is behind it where it is not (`divided_so`): with it 93.0 instead of 92.1 % of 3,156 pairs of the
    sixteen are told apart, of those between which the tracker hardly chooses 85.6 instead of 84.5."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if min(self.depth, self.shade, self.outline) < 0:
            raise MethodError(
                f"turns.drawn.depth is {self.depth:g}, shade {self.shade:g} and outline "
                f"{self.outline:g}: use 0 or more"
            )


@dataclass(frozen=True, slots=True, eq=False)
class _Shown:
    """The part of a frame around the poses."""

    depth: Plane
    """Planar, metres, 0 = none."""
    brightness: Plane
    """Logarithm."""
    bare: Plane
    """Depth without the part, metres; not finite where it is not known."""
    rim: Mask
    """Where any of the poses is, or its rim."""

    def hides(self, surface: Plane | float) -> Mask:
        """Where something is measured that is nearer than a surface."""
        return (self.depth > 0) & (self.depth < surface - HIDDEN_BY)


def drawn_looks(
    frame: Frame,
    mesh: Mesh,
    T_camera_parts: Transforms,
    *,
    table: Table | None,
    config: DrawnConfig,
    smear: Smear | None = None,
    others: Sequence[Placed] = (),
) -> Float64[np.ndarray, "n"] | None:
    """How well each pose of a part agrees with how it would look; only differences mean anything.

    Args:
        frame: with depth or without.
        mesh: of the part.
        T_camera_parts: its possible poses, about one place.
        table: under it, in the camera's frame, where it is known.
        config: what counts.
        smear: the depth camera's, where it is known.
        others: parts near it, where they are.

    Returns:
        None where too little of one of them is seen.
    """
    smear = smear or Smear()
    cut = _window_around(frame, mesh, T_camera_parts)
    if cut is None:
        return None
    pixels, size, K = cut
    before = _drawn(others, K, size_wh=size)[0] if others else None
    planes = [_drawn([(mesh, T)], K, size_wh=size, before=before) for T in T_camera_parts]
    shown = _shown(frame, pixels, K, [z for z, _ in planes], table, smear, before)
    values = config.outline * _outlined(frame, pixels, shown, [z for z, _ in planes])
    for k, (z, ids) in enumerate(planes):
        surface, is_hidden, seen, count = laid_over(z, shown.bare, shown.depth, HIDDEN_BY)
        if count < LEAST:
            return None
        normals = normals_shown(
            ids, seen, *face_planes(mesh), np.ascontiguousarray(T_camera_parts[k])
        )
        rest = _uneven(shown, seen, normals)
        gap = _gap(shown, surface, is_hidden, smear=smear, focal=float(K[0, 0]))
        if gap is None:
            return None
        values[k] -= config.depth * gap + config.shade * rest
    return values


def smear_gaps(
    frame: Frame, mesh: Mesh, T_camera_part: Transform, *, table: Table, smears: Sequence[Smear]
) -> Float64[np.ndarray, "s"] | None:
    """How far depth, drawn with each smear, is from what is measured about a pose: means, metres.

    None where something hides it, or too little is measured.
    """
    cut = _window_around(frame, mesh, T_camera_part[None])
    if cut is None:
        return None
    pixels, size, K = cut
    z, _ = _drawn([(mesh, T_camera_part)], K, size_wh=size)
    widest = max(smears, key=lambda smear: abs(smear.trail))
    shown = _shown(frame, pixels, K, [z], table, widest)
    surface = np.where(np.isfinite(z), z, shown.bare)
    is_hidden = shown.hides(surface)
    is_measured = np.count_nonzero(shown.depth[np.isfinite(z)] > 0) >= LEAST
    if not is_measured or not np.isfinite(surface).all():
        return None
    if float(is_hidden[np.isfinite(z)].mean()) > COVERED:
        return None
    focal = float(K[0, 0])
    gaps = [_gap(shown, surface, is_hidden, smear=smear, focal=focal) for smear in smears]
    return np.array(gaps, dtype=np.float64)


def _window_around(
    frame: Frame, mesh: Mesh, T_camera_parts: Transforms
) -> tuple[tuple[int, int, int, int], tuple[int, int], Intrinsics] | None:
    """x0 y0 x1 y1 around the poses, width and height, and K there; None where they are not in the
    picture."""
    boxes = np.stack([projected_box(T, mesh.vertices, frame) for T in T_camera_parts])
    around = box_around(boxes.reshape(-1, 2))
    pixels, K = window(around, frame, margin=EDGE)
    size_wh = pixels[2] - pixels[0], pixels[3] - pixels[1]
    return None if min(size_wh) <= 2 * EDGE else (pixels, size_wh, K)


def _drawn(
    placed: Sequence[Placed],
    K: Intrinsics,
    *,
    size_wh: tuple[int, int],
    before: Plane | None = None,
) -> tuple[Plane, Int32[np.ndarray, "h w"]]:
    """Depth of parts, inf where none is or one of those before is nearer, and the last one's faces that
    show."""
    inverse, ids = raster.new_buffers(*size_wh)
    for mesh, T_camera_part in placed:
        raster.draw(mesh, T_camera_part, K=K, inverse_depth=inverse, ids=ids)
    z = np.where(inverse > 0, 1.0 / np.maximum(inverse, 1e-9), np.inf).astype(np.float64)
    return (z if before is None else np.where(z <= before, z, np.inf)), ids


def _shown(
    frame: Frame,
    pixels: tuple[int, int, int, int],
    K: Intrinsics,
    planes: list[Plane],
    table: Table | None,
    smear: Smear,
    before: Plane | None = None,
) -> _Shown:
    """What the frame shows around the poses, and what it would show without the part."""
    x0, y0, x1, y1 = pixels
    here = (slice(y0, y1), slice(x0, x1))
    measured = (
        np.zeros((y1 - y0, x1 - x0), np.float32) if frame.depth is None else frame.depth[here]
    )
    any_of_them = np.any(np.isfinite(np.stack(planes)), axis=0)
    group = any_of_them.astype(np.uint8)
    beside = smear.trailing(grown(group, BESIDE), focal=float(K[0, 0]))
    bare = _without(measured, beside, K, table)
    if before is not None:
        bare = np.where(beside & np.isfinite(before), before, bare)
    red, green, blue = np.moveaxis(log_colors(frame.rgb[here]), 2, 0)
    grey = (red + green + blue) / 3
    return _Shown(measured.astype(np.float64), grey, bare, grown(group, RIM))


def _without(
    measured: Float32[np.ndarray, "h w"], beside: Mask, K: Intrinsics, table: Table | None
) -> Plane:
    """Depth without the part: the table where it may be, what is measured elsewhere."""
    if table is not None:
        rows, columns = np.ogrid[: measured.shape[0], : measured.shape[1]]
        unit = table.heights(np.ones_like(measured), rows=rows, columns=columns, K=K)
        slope = unit - table.offset
        under = -table.offset / np.minimum(slope, -1e-6)
    else:
        around = measured[(measured > 0) & ~beside]
        under = np.full(measured.shape, np.median(around) if len(around) else np.nan)
    return np.where(beside | (measured <= 0), under, measured).astype(np.float64)


def _outlined(
    frame: Frame, pixels: tuple[int, int, int, int], shown: _Shown, planes: list[Plane]
) -> Float64[np.ndarray, "n"]:
    """What `divided_so` says of each pose."""
    x0, y0, x1, y1 = pixels
    drawn = np.isfinite(np.stack(planes))
    hidden = shown.hides(min(float(z.min()) for z in planes))
    return divided_so(frame.rgb[y0:y1, x0:x1], drawn, hidden)


def _gap(
    shown: _Shown, surface: Plane, is_hidden: Mask, *, smear: Smear, focal: float
) -> float | None:
    """Mean distance between drawn, smeared depth and the measured one, metres.

    0 where no depth was measured or nothing is known of what lies behind; None where too little is.

    Args:
        shown: the picture.
        surface: depth of the part, and of what is there without it elsewhere.
        is_hidden: where something nearer is measured.
        smear: the depth camera's.
        focal: length, pixels.
    """
    if not np.isfinite(shown.bare).all() or not (shown.depth[shown.rim] > 0).any():
        return 0.0
    smeared = smear.applied(surface, focal=focal)
    gap, clear = mean_gap(smeared, shown.depth, shown.rim, is_hidden, LARGEST_GAP, HIDDEN)
    return float(gap) if clear >= LEAST else None


def _uneven(shown: _Shown, seen: Mask, normals: Float32[np.ndarray, "h w 4"]) -> float:
    """What a linear function of the normal leaves of the brightness' logarithm, root mean square.

    Args:
        shown: the picture.
        seen: where the part is.
        normals: of its surface there, camera axes, and ones.
    """
    smooth = cv2.GaussianBlur(normals, (0, 0), 0.8)
    inside = cv2.erode(seen.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    counted = inside if np.count_nonzero(inside) >= LEAST else seen
    return float(uneven(smooth, counted, shown.brightness, ROUNDS, LARGEST_UNEVEN))
