"""What is drawn in the scene besides meshes, as plain arrays: boxes, keypoints, the depth cloud. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float32, Float64, UInt8

from asdfviz.app.ar import DRAWING_DEPTH
from asdfviz.app.naming import short_names
from asdfviz.app.theme import Rgb3, ink
from asdfviz.datatypes import Assembly, Detection, Frame
from asdfviz.geometry.camera import back_project, points_from_depth
from asdfviz.geometry.shapes import Intrinsics, Pixels, Rotation, Transform, Vector
from asdfviz.geometry.transforms import transform_from
from asdfviz.render.state_ramp import state_color

FARTHEST = 2.5
"""Metres: what lies behind is the room, not the workpiece."""
_CROSS_PX = 3.0
_TAGS_WIDE = 1280
"""Pixels that a picture of tags is wide at least, about, so that they can be read."""
_TAG_RIM = 3
_NEUTRAL: Rgb3 = (230, 230, 230)
_Tag = tuple[str, Rgb3, tuple[int, int, int, int], int]
"""What a tag says, its colour, left, top, width and height, and the line that its letters stand on."""
Segments = Float32[np.ndarray, "s 2 3"]
Colors = UInt8[np.ndarray, "s 2 3"]


def detection_color(label: str, assembly: Assembly, colors: dict[str, Rgb3]) -> Rgb3:
    """The colour of the part, or of the state, that a detector class stands for."""
    for name, part in assembly.parts.items():
        if part.detector_class == label:
            return colors[name]
    for state in assembly.states:
        if state.detector_class == label:
            return state_color(state.completed, len(assembly.steps))
    return _NEUTRAL


def box_segments(
    detections: Sequence[Detection],
    K: Intrinsics,
    assembly: Assembly,
    colors: dict[str, Rgb3],
) -> tuple[Segments, Colors]:
    """Four lines a box, in front of everything."""
    corners = [
        np.array([[x0, y0], [x1, y0], [x1, y0], [x1, y1], [x1, y1], [x0, y1], [x0, y1], [x0, y0]])
        for x0, y0, x1, y1 in (d.box_xyxy for d in detections)
    ]
    inks = [(detection_color(d.label, assembly, colors), 4) for d in detections]
    return _lines(corners, inks, K)


def keypoint_dots(
    detections: Sequence[Detection],
    K: Intrinsics,
    assembly: Assembly,
    colors: dict[str, Rgb3],
) -> tuple[Segments, Colors]:
    """A small cross a keypoint; one that the network doubts is left out."""
    corners: list[np.ndarray] = []
    inks: list[tuple[Rgb3, int]] = []
    arms = np.array([[-1, 0], [1, 0], [0, -1], [0, 1]]) * _CROSS_PX
    for detection in detections:
        sure = detection.keypoints_px[detection.keypoint_scores >= 0.5]
        corners.extend(point + arms for point in sure)
        inks.append((detection_color(detection.label, assembly, colors), 2 * len(sure)))
    return _lines(corners, inks, K)


def short_labels(assembly: Assembly) -> dict[str, str]:
    """The network's classes as short as their tags need them, those of parts and of states apart."""
    parts = dict.fromkeys(part.detector_class for part in assembly.parts.values())
    states = [s.detector_class for s in assembly.states if s.detector_class is not None]
    return {**short_names(dict.fromkeys(states)), **short_names(parts)}


def name_tags(
    detections: Sequence[Detection],
    size_wh: tuple[int, int],
    assembly: Assembly,
    colors: dict[str, Rgb3],
) -> UInt8[np.ndarray, "h w 4"]:
    """Class and score of every box in a tag of its colour, as a picture to lay over the frame.

    The tag stands above its box, or where a surer one is in the way, within or below it.
    """
    scale = max(1, round(_TAGS_WIDE / size_wh[0]))
    width, height = size_wh[0] * scale, size_wh[1] * scale
    canvas = np.zeros((height, width, 4), np.uint8)
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.62 * width / _TAGS_WIDE
    taken = np.zeros((height, width), bool)
    tags: list[_Tag] = []
    shorts = short_labels(assembly)
    for detection in sorted(detections, key=lambda one: -one.score):
        says = f"{shorts.get(detection.label, detection.label)} {100 * detection.score:.0f} %"
        (wide, tall), below = cv2.getTextSize(says, font, size, 2)
        wide, high = wide + 2 * _TAG_RIM, tall + below + 2 * _TAG_RIM
        x0, y0, _, y1 = (int(value) for value in (detection.box_xyxy + 0.5) * scale)
        x = min(max(x0, 0), max(width - wide, 0))
        wished = (y0 - high, y0, y1, y1 - high, y0 - 2 * high, y1 + high)
        tops = [min(max(top, 0), max(height - high, 0)) for top in wished]
        y = next((y for y in tops if not taken[y : y + high, x : x + wide].any()), tops[0])
        taken[y : y + high, x : x + wide] = True
        color = detection_color(detection.label, assembly, colors)
        tags.append((says, color, (x, y, wide, high), y + _TAG_RIM + tall))
    for says, color, (x, y, wide, high), line in reversed(tags):  # the surest on top
        canvas[y : y + high, x : x + wide] = (*color, 255)
        at = (x + _TAG_RIM, line)
        cv2.putText(canvas, says, at, font, size, (*ink(color), 255), 2, cv2.LINE_AA)
    return canvas


def depth_cloud(
    frame: Frame, *, stride: int
) -> tuple[Float64[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
    """The measured points (metres, camera frame) and their colours."""
    if frame.depth is None:
        return np.zeros((0, 3)), np.zeros((0, 3), np.uint8)
    points, pixels = points_from_depth(frame.depth, frame.camera.K, stride=stride)
    near = points[:, 2] < FARTHEST
    u, v = pixels[near].astype(int).T
    return points[near], frame.rgb[v, u]


def wxyz_of(R: Rotation) -> Float64[np.ndarray, 4]:
    """The unit quaternion of a rotation, real part first and not negative (Shepperd, 1978)."""
    trace = float(np.trace(R))
    squares = np.array([trace, R[0, 0], R[1, 1], R[2, 2]])
    i = int(squares.argmax())
    if i == 0:
        q = np.array([1 + trace, R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    else:
        a, b, c = i - 1, i % 3, (i + 1) % 3
        q = np.empty(4)
        q[0] = R[c, b] - R[b, c]
        q[1 + a] = 1 + R[a, a] - R[b, b] - R[c, c]
        q[1 + b] = R[a, b] + R[b, a]
        q[1 + c] = R[a, c] + R[c, a]
    q /= np.linalg.norm(q)
    return -q if q[0] < 0 else q


def T_from_wxyz(wxyz: np.ndarray, position: np.ndarray) -> Transform:
    """The transform of a viser node (T_parent_node)."""
    w, x, y, z = np.asarray(wxyz, float) / np.linalg.norm(wxyz)
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return transform_from(R, _vector(position))


def _vector(values: np.ndarray) -> Vector:
    return np.asarray(values, np.float64).reshape(3)


def _lines(
    corners: list[Pixels], inks: list[tuple[Rgb3, int]], K: Intrinsics
) -> tuple[Segments, Colors]:
    if not corners:
        return np.zeros((0, 2, 3), np.float32), np.zeros((0, 2, 3), np.uint8)
    pixels = np.concatenate(corners)
    points = back_project(pixels, np.full(len(pixels), DRAWING_DEPTH), K)
    colors = np.concatenate(
        [np.tile(np.array(color, np.uint8), (2 * count, 1)) for color, count in inks]
    )
    return points.astype(np.float32).reshape(-1, 2, 3), colors.reshape(-1, 2, 3)
