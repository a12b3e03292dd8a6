"""Checks that need truth: do the parts, at their true poses, lie where the depth images see them?

Points of each part's surface are put at the true pose and compared with the depth measured behind
their pixels. A factor between both is a wrong unit; a better fit with another focal length,
principal point or mesh scale is a wrong camera or mesh.
"""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Sequence as Rows
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly, Camera, Frame, FrameTruth, Mesh
from asdfviz.evaluate.health_report import Finding
from asdfviz.geometry.camera import project
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Depth, Pixels, Points, Scores
from asdfviz.geometry.transforms import apply

_LEAST_VISIBLE = 0.3
_LEAST_FIT = 0.4
"""Share of the surface that must lie on measured depth before another camera is believed."""
_LEAST_POINTS = 200
_LEAST_GAIN = 1.25
"""How much larger that share must become."""
_POINTS_A_PART = 1500
_MESH_FACTORS = (1e-3, 1e-2, 0.0254, 0.1, 10.0, 1 / 0.0254, 1e2, 1e3)


@dataclass(frozen=True, slots=True)
class Posed:
    """A part at its true pose in a frame that was looked at."""

    part: str
    frame: Frame
    truth: FrameTruth


@dataclass(frozen=True, slots=True, eq=False)
class _Sight:
    """Surface points that the camera should see, and the image that they are compared with."""

    pixels: Pixels
    z: Scores
    depth: Depth
    camera: Camera


def check_against_truth(posed: Rows[Posed], assembly: Assembly) -> Iterator[Finding]:
    """Compare truth with depth; the first thing that explains a mismatch is reported."""
    surfaces = {
        name: surface_points(part.mesh.vertices, part.mesh.faces, _POINTS_A_PART)
        for name, part in assembly.parts.items()
        if _has_area(part.mesh)
    }
    seen = [p for p in posed if p.part in surfaces]
    giants = list(_giants(seen, assembly))
    yield from giants
    sights = [s for p in seen if (s := _sight(p, surfaces[p.part])) is not None]
    ratio = _median_ratio(sights)
    if giants or ratio is None:
        return
    if not 0.6 < ratio < 1.7:
        yield Finding(
            "depth_unit",
            "error",
            f"Depth is {ratio:.3g} times the distance of the true poses: the depth unit is wrong "
            f"(or the truth's, which must be mm). Divide depth_scale by {ratio:.3g}.",
            ratio,
        )
        return
    cameras = list(_camera_findings(sights))
    yield from cameras
    # A wrong camera makes tiny meshes fit better, too: they hide within the parts' outlines.
    if not cameras:
        yield from _mesh_findings(seen, surfaces, assembly)


def posed_parts(frames: Rows[tuple[Frame, FrameTruth | None]]) -> tuple[Posed, ...]:
    """Every part that is visible enough (30 %, where that is known) in every frame with truth."""
    return tuple(
        Posed(part=name, frame=frame, truth=truth)
        for frame, truth in frames
        if truth is not None
        for name in truth.T_camera_part
        if truth.visible.get(name, 1.0) >= _LEAST_VISIBLE
    )


def _giants(posed: Rows[Posed], assembly: Assembly) -> Iterator[Finding]:
    """Parts so large or small for their distance that only a wrong unit explains them."""
    ratios: dict[str, list[float]] = {}
    for p in posed:
        distance = float(np.linalg.norm(p.truth.T_camera_part[p.part][:3, 3]))
        ratios.setdefault(p.part, []).append(assembly.parts[p.part].diameter / max(distance, 1e-9))
    for name, values in ratios.items():
        ratio = float(np.median(values))
        if not 0.002 < ratio < 3.0:
            size_mm = 1e3 * assembly.parts[name].diameter
            yield Finding(
                "mesh_unit",
                "error",
                f"{name} is {size_mm:.3g} mm across but truth puts it {size_mm / ratio:.3g} mm "
                f"away ({ratio:.2g} of it): its mesh, or cam_t_m2c, is in the wrong unit. Meshes "
                "follow 'unit' in assembly.yaml, cam_t_m2c is mm.",
                ratio,
            )


def _mesh_findings(
    posed: Rows[Posed], surfaces: dict[str, Points], assembly: Assembly
) -> Iterator[Finding]:
    for name in dict.fromkeys(p.part for p in posed):
        of_part = [p for p in posed if p.part == name][:6]
        share = _share_of_mesh(of_part, surfaces[name])
        if share is None or share > 0.4:
            continue
        scaled = {
            factor: _share_of_mesh(of_part, factor * surfaces[name]) or 0.0
            for factor in _MESH_FACTORS
            # A mesh shrunk to a point fits whatever surface lies at its origin.
            if 0.005 < factor * assembly.parts[name].diameter < 1.5
        }
        if not scaled:
            continue
        best = max(scaled, key=lambda f: scaled[f])
        if scaled[best] > max(0.5, 2.5 * share):
            yield Finding(
                "mesh_unit",
                "error",
                f"{name} fits the depth images only when its mesh is scaled by {best:.4g} "
                f"({100 * scaled[best]:.0f} % of its surface, now {100 * share:.0f} %): a mesh in "
                "the wrong unit. Set the part's 'unit' in assembly.yaml.",
                best,
            )


def _camera_findings(sights: Rows[_Sight]) -> Iterator[Finding]:
    sights = _thinned(sights)
    width = max(sight.camera.width for sight in sights)
    now = _share(sights, scale=1.0, shift=np.zeros(2))
    if now * _LEAST_GAIN > 1.0:
        return
    scale, by_scale = _best_scale(sights)
    shift, by_shift = _best_shift(sights, reach=0.1 * width)
    best = max(by_scale, by_shift)
    if best < _LEAST_FIT or best < _LEAST_GAIN * now:
        return
    gain = f"({100 * best:.0f} % of the parts' surface fits, now {100 * now:.0f} %)"
    if by_scale >= by_shift:
        if abs(scale - 1.0) > 0.03:
            yield Finding(
                "intrinsics",
                "error",
                f"True poses and depth agree best with a focal length {scale:.2f} times as long "
                f"{gain}: wrong intrinsics. Check fx and fy.",
                scale,
            )
    elif np.linalg.norm(shift) > 0.015 * width:
        yield Finding(
            "intrinsics",
            "error",
            f"True poses and depth agree best with the principal point moved by "
            f"({shift[0]:.0f}, {shift[1]:.0f}) px {gain}: wrong intrinsics. Check cx and cy.",
            float(np.linalg.norm(shift)),
        )


def _best_scale(sights: Rows[_Sight]) -> tuple[float, float]:
    """The factor on the focal length that fits best, and the share that fits with it."""
    scales = np.geomspace(0.5, 2.0, 94)
    shares = [_share(sights, scale=float(s), shift=np.zeros(2)) for s in scales]
    return float(scales[int(np.argmax(shares))]), max(shares)


def _best_shift(sights: Rows[_Sight], *, reach: float) -> tuple[np.ndarray, float]:
    """The move of the principal point (px) that fits best, and its share: a grid, then finer."""
    center, step = np.zeros(2), reach / 10.0
    steps = np.arange(-10, 11)
    while True:
        moves = np.array([center + step * np.array([x, y]) for x in steps for y in steps])
        shares = [_share(sights, scale=1.0, shift=move) for move in moves]
        center = moves[int(np.argmax(shares))]
        if step < 1.0:
            return center, max(shares)
        step, steps = step / 2.0, np.arange(-1, 2)


def _sight(posed: Posed, surface: Points) -> _Sight | None:
    """Project the part's surface and keep what is in front; None where nothing is in the image."""
    frame = posed.frame
    if frame.depth is None:
        return None
    points = apply(posed.truth.T_camera_part[posed.part], surface)
    points = points[points[:, 2] > 0.01]
    pixels = project(points, frame.camera.K)
    inside = ((pixels >= 0) & (pixels < [frame.camera.width, frame.camera.height])).all(axis=1)
    if inside.sum() < 20:
        return None
    pixels, z = pixels[inside], points[inside, 2]
    front = _in_front(pixels, z)
    return _Sight(pixels=pixels[front], z=z[front], depth=frame.depth, camera=frame.camera)


def _in_front(pixels: Pixels, z: Scores) -> np.ndarray:
    """Which points are nearest within their cell of a grid over the part: a coarse depth buffer."""
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    cells = max(int(np.sqrt(len(z) / 6)), 1)
    place = ((pixels - low) / np.maximum(high - low, 1e-9) * cells).astype(np.int64)
    place = np.minimum(place, cells - 1)
    cell = place[:, 0] * cells + place[:, 1]
    nearest = np.full(cells * cells, np.inf)
    np.minimum.at(nearest, cell, z)
    return z <= nearest[cell] + 0.005


def _measured(sight: _Sight, *, scale: float = 1.0, shift: np.ndarray | None = None) -> Scores:
    """Depth behind the points when their pixels are moved about the principal point; 0 outside."""
    center = sight.camera.K[:2, 2]
    moved = (sight.pixels - center) * scale + center + (0.0 if shift is None else shift)
    uv = np.rint(moved).astype(np.int64)
    height, width = sight.depth.shape
    inside = ((uv >= 0) & (uv < [width, height])).all(axis=1)
    uv = uv.clip(0, [width - 1, height - 1])
    return np.where(inside, sight.depth[uv[:, 1], uv[:, 0]], 0.0).astype(np.float64)


def _median_ratio(sights: Rows[_Sight]) -> float | None:
    """Measured over true depth; None where too few points are measured."""
    ratios: list[Scores] = []
    for sight in sights:
        measured = _measured(sight)
        ratios.append(measured[measured > 0] / sight.z[measured > 0])
    values = np.concatenate(ratios) if ratios else np.empty(0)
    return float(np.median(values)) if len(values) >= _LEAST_POINTS else None


def _share(sights: Rows[_Sight], *, scale: float, shift: np.ndarray) -> float:
    """Share of the points whose measured depth is the true one; points outside do not fit."""
    fitting, count = 0, 0
    for sight in sights:
        measured = _measured(sight, scale=scale, shift=shift)
        fitting += int(_fits(measured, sight.z).sum())
        count += len(sight.z)
    return fitting / max(count, 1)


def _fits(measured: Scores, z: Scores) -> np.ndarray:
    # Wide enough for a sensor's bias on plastic, narrow enough to tell a part from its table.
    return np.abs(measured - z) < np.maximum(0.008, 0.008 * z)


def _share_of_mesh(posed: Rows[Posed], surface: Points) -> float | None:
    sights = [s for p in posed if (s := _sight(p, surface)) is not None]
    if not sights:
        return None
    return _share(sights, scale=1.0, shift=np.zeros(2))


def _thinned(sights: Rows[_Sight], most: int = 2500) -> list[_Sight]:
    every = max(1, -(-sum(len(sight.z) for sight in sights) // most))
    return [_Sight(s.pixels[::every], s.z[::every], s.depth, s.camera) for s in sights]


def _has_area(mesh: Mesh) -> bool:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return bool(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() > 0)
