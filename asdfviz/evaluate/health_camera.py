"""Checks on intrinsics, mesh sizes and states that need no truth: what cameras and parts can be at all."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from asdfviz.data.folder_sequence import FolderSequence
from asdfviz.datatypes import Assembly, Camera
from asdfviz.errors import counted
from asdfviz.evaluate.health_report import Finding
from asdfviz.geometry.camera import is_same_lens

NARROWEST_DEG, WIDEST_DEG = 20.0, 130.0
"""Horizontal field of view of RGB-D cameras, degrees (Kinect's wide mode has 120)."""
SQUARE = 0.1
"""Largest difference of fx and fy, as a share."""
LIKELY_DISTANCE = (0.2, 3.0)
"""Metres within which a table-top scene lies."""
OFF_CENTER = 0.15
"""Largest distance of the principal point from the image's centre, as a share of its size."""
NEAR_CENTER = 0.06
"""Largest such distance, as a share of half the size, of what counts as the centre."""
SMALLEST_SHARE = 0.03
"""Size of the largest part as a share of what the camera sees across: below, it is a few pixels."""
FARTHEST_ORIGIN = 10.0
"""A part's origin lies no farther from its middle than so many diameters, unless by mistake."""
SHORTEST_OFFSET, LEAST_PART = 0.5e-3, 10e-3
"""Metres: where parts are this large, no state has all of them nearer than this, but not in, their base."""
RESIZES = (0.25, 1 / 3, 0.375, 0.5, 2 / 3, 0.75, 4 / 3, 1.5, 2.0, 3.0, 4.0)
"""By how much images are usually resized without their intrinsics."""


def check_intrinsics(camera: Camera) -> Iterator[Finding]:
    """Judge focal length and principal point against the image's size."""
    fx, fy, cx, cy = camera.K[0, 0], camera.K[1, 1], camera.K[0, 2], camera.K[1, 2]
    size = f"{camera.width} x {camera.height}"
    resize = _resize(camera)
    if resize is not None:
        yield Finding(
            "intrinsics",
            "error",
            f"The principal point ({cx:.1f}, {cy:.1f}) is the centre of an image {resize:.3g} "
            f"times as large as these ({size}): the intrinsics belong to another resolution. "
            f"Divide fx, fy, cx and cy by {resize:.3g}.",
            float(resize),
        )
        return
    if not (0 <= cx < camera.width and 0 <= cy < camera.height):
        yield Finding(
            "intrinsics",
            "error",
            f"The principal point ({cx:.1f}, {cy:.1f}) lies outside the image ({size}): wrong "
            "intrinsics. It is near the centre for every common camera.",
        )
    elif abs(cx / camera.width - 0.5) > OFF_CENTER or abs(cy / camera.height - 0.5) > OFF_CENTER:
        yield Finding(
            "intrinsics",
            "warning",
            f"The principal point ({cx:.1f}, {cy:.1f}) is far from the centre of the image "
            f"({size}). Were the images cropped after calibration?",
        )
    view_deg = float(np.rad2deg(2.0 * np.arctan(camera.width / (2.0 * fx))))
    if not NARROWEST_DEG <= view_deg <= WIDEST_DEG:
        yield Finding(
            "intrinsics",
            "error",
            f"fx = {fx:.4g} px gives a view of {view_deg:.3g} degrees across, cameras have "
            f"{NARROWEST_DEG:g} to {WIDEST_DEG:g}: wrong intrinsics. fx must be in pixels of the "
            f"{size} images.",
            view_deg,
        )
    elif abs(fx / fy - 1.0) > SQUARE:
        yield Finding(
            "intrinsics",
            "warning",
            f"fx and fy differ by {100 * abs(fx / fy - 1):.0f} % ({fx:.1f} and {fy:.1f} px): "
            "pixels of common cameras are square. Check both.",
            float(fx / fy),
        )


def check_one_camera(source: FolderSequence) -> Iterator[Finding]:
    """Look for frames with other intrinsics than the first: some methods know one camera only."""
    first, *others = source.frame_indices
    K = source.camera_of(first).K
    other = [index for index in others if not is_same_lens(source.camera_of(index).K, K)]
    if other:
        yield Finding(
            "several_cameras",
            "warning",
            f"{counted(len(other), 'frame')} of {len(source)} have other intrinsics than frame "
            f"{first}, frame {other[0]} first. Each frame is drawn, judged and seen by asdf with its "
            "own, but trackers, asdf_plus and asdf_track need one camera and refuse the sequence.",
            float(len(other)),
        )


def size_finding(camera: Camera, images_wh: tuple[int, int]) -> Finding:
    """What to change where the camera file has another size than all colour images."""
    width, height = images_wh
    cx, cy = camera.K[0, 2], camera.K[1, 2]
    said, images = f"{camera.width} x {camera.height}", f"{width} x {height}"
    factor = width / camera.width
    is_scaled = abs(height / camera.height / factor - 1.0) < 0.02
    if _is_centred(cx, cy, width, height):
        advice = f"is the centre of these: set 'width' and 'height' to {width} and {height}"
    elif _is_centred(cx, cy, camera.width, camera.height) and is_scaled:
        advice = (
            f"is the centre of {said}: multiply fx, fy, cx and cy by {factor:.3g}, and set 'width' "
            f"and 'height' to {width} and {height}"
        )
    else:
        advice = (
            f"is the centre of neither: give the intrinsics of {images} images, with their 'width' "
            "and 'height'"
        )
    return Finding(
        "size_mismatch",
        "error",
        f"The camera file says {said}, but all images looked at are {images}. The principal point "
        f"({cx:.1f}, {cy:.1f}) {advice}.",
        factor,
    )


def _is_centred(cx: float, cy: float, width: int, height: int) -> bool:
    across, down = 2.0 * cx / width, 2.0 * cy / height
    return bool(abs(across - 1.0) < NEAR_CENTER and abs(down - 1.0) < NEAR_CENTER)


def check_offsets(assembly: Assembly) -> Iterator[Finding]:
    """Look for states whose offsets are a thousand times too short; meshes that share one origin have none."""
    size = max(part.diameter for part in assembly.parts.values())
    longest = {
        state.name: max(float(np.linalg.norm(T[:3, 3])) for T in state.T_base_part.values())
        for state in assembly.states
    }
    short = {name: x for name, x in longest.items() if 0.0 < x < SHORTEST_OFFSET}
    if short and size >= LEAST_PART:
        apart = 1e3 * max(short.values())
        yield Finding(
            "state_unit",
            "warning",
            f"The state(s) {', '.join(short)} put every part within {apart:.2g} mm of the base's "
            f"origin, though parts are up to {1e3 * size:.0f} mm large: their 't' look like metres. "
            "Give them in the 'unit' of assembly.yaml.",
            apart,
        )


def check_origins(assembly: Assembly) -> Iterator[Finding]:
    """Look for parts whose poses are told of a point far from them."""
    for part in assembly.parts.values():
        away = float(np.linalg.norm(part.middle))
        if away > FARTHEST_ORIGIN * part.diameter:
            yield Finding(
                "far_origin",
                "warning",
                f"The origin of part '{part.name}' lies {1e3 * away:.0f} mm from the middle of its "
                f"mesh, which is {1e3 * part.diameter:.0f} mm across. Poses, and the places that "
                "states have, are those of the origin: unless that is meant, move the mesh there.",
                away,
            )


def _resize(camera: Camera) -> float | None:
    """The usual factor whose image has the principal point at its centre; None where none fits."""
    for factor in RESIZES:
        cx, cy = camera.K[:2, 2] / factor
        if _is_centred(cx, cy, camera.width, camera.height):
            return factor
    return None


def check_part_sizes(
    assembly: Assembly, camera: Camera, distance: float | None
) -> Iterator[Finding]:
    """Compare the parts with one another, and with what the camera sees at the scene's distance.

    Args:
        assembly: the parts.
        camera: of the sequence.
        distance: median depth of the scene in metres, where it is known and plausible.
    """
    sizes = {name: part.diameter for name, part in assembly.parts.items()}
    largest = max(sizes, key=lambda name: sizes[name])
    if distance is not None:
        seen = distance * camera.width / camera.K[0, 0]
        share = sizes[largest] / seen
        if not SMALLEST_SHARE <= share <= 2.0:
            yield Finding(
                "mesh_unit",
                "error",
                f"The largest part, {largest}, is {1e3 * sizes[largest]:.3g} mm across, {share:.2g} "
                f"times the {1e3 * seen:.0f} mm that the camera sees there: "
                f"{_wrong_unit(distance, share)}",
                share,
            )
            return
    yield from check_relative_sizes(assembly)


def _wrong_unit(distance: float, share: float) -> str:
    """Which unit is wrong where a part is too small or large for what is seen at a distance (metres)."""
    mesh = "Set 'unit' in assembly.yaml to the mesh file's unit."
    near, far = LIKELY_DISTANCE
    for factor in (0.1, 10.0):
        is_likely = near <= distance * factor <= far and SMALLEST_SHARE <= share / factor <= 2.0
        if is_likely and not near <= distance <= far:
            return (
                f"depth or mesh is in a wrong unit. If the table is about {distance * factor:.2g} m "
                f"away, not {distance:.2g} m, multiply depth_scale (millimetres per unit) by "
                f"{factor:g}. If not: {mesh[0].lower()}{mesh[1:]}"
            )
    return f"a mesh in the wrong unit. {mesh}"


def check_relative_sizes(assembly: Assembly) -> Iterator[Finding]:
    """Compare the parts with one another."""
    sizes = {name: part.diameter for name, part in assembly.parts.items()}
    median = float(np.median(list(sizes.values())))
    for name, size in sizes.items():
        ratio = size / median
        if not 1 / 40 <= ratio <= 40:
            yield Finding(
                "mesh_unit",
                "warning",
                f"{name} is {1e3 * size:.3g} mm across, {ratio:.2g} times the middle part: its "
                "mesh is probably in another unit. Give the part its own 'unit'.",
                ratio,
            )
