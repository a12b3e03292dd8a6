"""Checks that need truth: do the parts, at their true poses, lie where the depth images see them?

Points of each part's surface are put at the true pose and compared with the depth measured behind
their pixels. A factor between both is a wrong unit; a better fit with another focal length,
principal point or mesh scale is a wrong camera or mesh. Where the other parts fit as they are, a part
that the camera saw through has a wrong pose: no camera is wrong for one part alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from collections.abc import Sequence as Rows

import numpy as np

from asdfviz.datatypes import Assembly, Mesh
from asdfviz.errors import some
from asdfviz.evaluate.health_report import Finding
from asdfviz.evaluate.health_sights import (
    Posed,
    Sight,
    fitting_share,
    measured_behind,
    seen_through,
    sight_of,
    thinned,
)
from asdfviz.geometry.sampling import surface_points
from asdfviz.geometry.shapes import Points, Scores

_LEAST_FIT = 0.4
"""Share of the surface that must lie on measured depth before another camera is believed."""
_LEAST_POINTS = 200
_LEAST_GAIN = 1.25
"""How much larger that share must become."""
_MOST_OF_MISPLACED = 0.38
"""Share that fits of what nothing hides of a part; less says that the part is elsewhere."""
_LEAST_OF_OTHERS = 0.75
"""The same of the other parts together, without which the camera may be at fault."""
_POINTS_A_PART = 1500
_MESH_FACTORS = (1e-3, 1e-2, 0.0254, 0.1, 10.0, 1 / 0.0254, 1e2, 1e3)


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
    by_part = {
        name: [s for p in seen if p.part == name and (s := sight_of(p, surfaces[name])) is not None]
        for name in dict.fromkeys(p.part for p in seen)
    }
    sights = [sight for of_part in by_part.values() for sight in of_part]
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
    misplaced = _misplaced(seen, by_part)
    cameras = [] if misplaced else list(_camera_findings(sights))
    yield from cameras
    # A wrong camera makes tiny meshes fit better, too: they hide within the parts' outlines.
    if not cameras:
        for name in by_part:
            mesh = _mesh_finding(name, seen, surfaces[name], assembly)
            finding = misplaced.get(name) if mesh is None else mesh
            if finding is not None:
                yield finding


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


def _misplaced(posed: Rows[Posed], sights: Mapping[str, Rows[Sight]]) -> dict[str, Finding]:
    """What is to be said of the parts that the camera saw through while the others fit, by part."""
    counts = {name: seen_through(of_part) for name, of_part in sights.items()}
    off = {
        name: fitting / (fitting + beyond)
        for name, (fitting, beyond) in counts.items()
        if fitting + beyond >= _LEAST_POINTS and fitting < _MOST_OF_MISPLACED * (fitting + beyond)
    }
    others = (
        np.array([counts[name] for name in counts if name not in off]).reshape(-1, 2).sum(axis=0)
    )
    if others.sum() < _LEAST_POINTS or others[0] < _LEAST_OF_OTHERS * others.sum():
        return {}
    return {
        name: Finding(
            "part_pose",
            "warning",
            f"{name} is not where the truth has it: the camera measured more depth behind "
            f"{100 * (1 - share):.0f} % of what nothing hides of it, while the other parts fit "
            f"({100 * others[0] / others.sum():.0f} %). Its pose is wrong, or the state that says where "
            f"it is; frames looked at: {some(p.frame.index for p in posed if p.part == name)}.",
            share,
        )
        for name, share in off.items()
    }


def _mesh_finding(
    name: str, posed: Rows[Posed], surface: Points, assembly: Assembly
) -> Finding | None:
    of_part = [p for p in posed if p.part == name][:6]
    share = _share_of_mesh(of_part, surface)
    if share is None or share > 0.4:
        return None
    scaled = {
        factor: _share_of_mesh(of_part, factor * surface) or 0.0
        for factor in _MESH_FACTORS
        # A mesh shrunk to a point fits whatever surface lies at its origin.
        if 0.005 < factor * assembly.parts[name].diameter < 1.5
    }
    best = max(scaled, key=lambda f: scaled[f], default=None)
    if best is None or scaled[best] <= max(0.5, 2.5 * share):
        return None
    return Finding(
        "mesh_unit",
        "error",
        f"{name} fits the depth images only when its mesh is scaled by {best:.4g} "
        f"({100 * scaled[best]:.0f} % of its surface, now {100 * share:.0f} %): a mesh in "
        "the wrong unit. Set the part's 'unit' in assembly.yaml.",
        best,
    )


def _camera_findings(sights: Rows[Sight]) -> Iterator[Finding]:
    sights = thinned(sights)
    width = max(sight.camera.width for sight in sights)
    now = fitting_share(sights, scale=1.0, shift=np.zeros(2))
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


def _best_scale(sights: Rows[Sight]) -> tuple[float, float]:
    """The factor on the focal length that fits best, and the share that fits with it."""
    scales = np.geomspace(0.5, 2.0, 94)
    shares = [fitting_share(sights, scale=float(s), shift=np.zeros(2)) for s in scales]
    return float(scales[int(np.argmax(shares))]), max(shares)


def _best_shift(sights: Rows[Sight], *, reach: float) -> tuple[np.ndarray, float]:
    """The move of the principal point (px) that fits best, and its share: a grid, then finer."""
    center, step = np.zeros(2), reach / 10.0
    steps = np.arange(-10, 11)
    while True:
        moves = np.array([center + step * np.array([x, y]) for x in steps for y in steps])
        shares = [fitting_share(sights, scale=1.0, shift=move) for move in moves]
        center = moves[int(np.argmax(shares))]
        if step < 1.0:
            return center, max(shares)
        step, steps = step / 2.0, np.arange(-1, 2)


def _median_ratio(sights: Rows[Sight]) -> float | None:
    """Measured over true depth; None where too few points are measured."""
    ratios: list[Scores] = []
    for sight in sights:
        measured = measured_behind(sight)
        ratios.append(measured[measured > 0] / sight.z[measured > 0])
    values = np.concatenate(ratios) if ratios else np.empty(0)
    return float(np.median(values)) if len(values) >= _LEAST_POINTS else None


def _share_of_mesh(posed: Rows[Posed], surface: Points) -> float | None:
    sights = [s for p in posed if (s := sight_of(p, surface)) is not None]
    if not sights:
        return None
    return fitting_share(sights, scale=1.0, shift=np.zeros(2))


def _has_area(mesh: Mesh) -> bool:
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    return bool(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() > 0)
