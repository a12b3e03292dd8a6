"""The worst frames of a run as pictures: what it said, filled in, and the truth as a white outline."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import UInt8

from asdfviz.data.encoding import encoded
from asdfviz.datatypes import Assembly, Frame
from asdfviz.evaluate.inputs import Result
from asdfviz.evaluate.judgement import Judgement
from asdfviz.evaluate.pose_errors import PoseError
from asdfviz.evaluate.records import PoseRecord
from asdfviz.evaluate.report_style import part_color
from asdfviz.evaluate.worst import worst_frames
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Rgb, Transform
from asdfviz.geometry.transforms import apply
from asdfviz.render.overlay import draw_outlines, draw_overlay
from asdfviz.render.renderer import Renderer

_SHOT_WH = (480, 360)
_CONTEXT = 2.2
"""How much wider than the part the picture is."""


@dataclass(frozen=True, slots=True)
class Shot:
    """One picture for the page."""

    frame_index: int
    part: str
    error: PoseError
    jpeg: str
    """As a data URI."""


def worst_shots(
    result: Result, judgement: Judgement, *, count: int, max_bytes: int
) -> Iterator[Shot]:
    """Draw the worst frames, each in at most `max_bytes` of JPEG.

    Raises:
        SequenceError: the frames are gone or broken.
        RenderError: nothing can be drawn here.
    """
    worst = worst_frames(judgement.comparison.records, count=count)
    if not worst:
        return
    sequence = result.sequence
    places = {index: place for place, index in enumerate(sequence.frame_indices)}
    with Renderer(sequence.camera.width, sequence.camera.height) as renderer:
        for record, error in ((one.record, one.error) for one in worst):
            if record.frame_index not in places:
                continue
            frame = sequence[places[record.frame_index]]
            said = judgement.predictions[record.frame_index].poses
            poses = {name: pose.T_camera_part for name, pose in said.items()}
            picture = _draw(frame, record, poses, judgement.assembly, renderer)
            data = _jpeg(_crop(picture, frame, record, judgement.assembly), max_bytes)
            uri = f"data:image/jpeg;base64,{base64.b64encode(data).decode('ascii')}"
            yield Shot(record.frame_index, record.part, error, uri)


def _draw(
    frame: Frame,
    record: PoseRecord,
    poses: Mapping[str, Transform],
    assembly: Assembly,
    renderer: Renderer,
) -> Rgb:
    K = frame.camera.K
    colors = {name: _rgb(part_color(place)) for place, name in enumerate(assembly.parts)}
    picture = draw_overlay(
        frame.rgb, poses, assembly, K, renderer=renderer, opacity=0.55, colors=colors
    )
    mesh = assembly.parts[record.part].mesh
    _, ids = renderer.depth_and_ids([mesh], [record.T_camera_truth], K)
    white = np.full(3, 255, dtype=np.uint8)
    dark = draw_outlines(picture, ids, [np.zeros(3)], width_px=5)
    return draw_outlines(dark, ids, [white], width_px=2)


def _crop(
    picture: Rgb, frame: Frame, record: PoseRecord, assembly: Assembly
) -> UInt8[np.ndarray, "rows columns 3"]:
    """Cut out the part in both poses with its surroundings, in the shape of a shot."""
    vertices = assembly.parts[record.part].mesh.vertices
    Ts = [T for T in (record.T_camera_truth, record.T_camera_estimate) if T is not None]
    pixels = np.concatenate([project(apply(T, vertices), frame.camera.K) for T in Ts])
    height, width = picture.shape[:2]
    shape = _SHOT_WH[0] / _SHOT_WH[1]
    pixels = np.clip(pixels[np.isfinite(pixels).all(axis=1)], 0, [width - 1, height - 1])
    if len(pixels) == 0:
        return picture
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    wide = max(_CONTEXT * max(high[0] - low[0], shape * (high[1] - low[1])), width / 3)
    wide = min(wide, width, shape * height)
    size = np.array([wide, wide / shape])
    corner = np.clip((low + high - size) / 2, 0, [width, height] - size)
    (u, v), (w, h) = np.floor(corner).astype(int), np.floor(size).astype(int)
    cut = np.ascontiguousarray(picture[v : v + h, u : u + w])
    shrinks = w > _SHOT_WH[0]
    return np.asarray(
        cv2.resize(cut, _SHOT_WH, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_CUBIC),
        dtype=np.uint8,
    )


def _jpeg(picture: Rgb, max_bytes: int) -> bytes:
    """Encode as well as the space allows; the last resort is half the size."""
    bgr = cv2.cvtColor(picture, cv2.COLOR_RGB2BGR)
    for scale in (1.0, 0.5):
        image = bgr if scale == 1.0 else cv2.resize(bgr, None, fx=scale, fy=scale)
        for quality in (85, 70, 50, 30):
            data = encoded(image, suffix=".jpg", options=[cv2.IMWRITE_JPEG_QUALITY, quality])
            if len(data) <= max_bytes:
                return data
    return data


def _rgb(color: str) -> np.ndarray:
    values: Sequence[int] = [int(color[i : i + 2], 16) for i in (1, 3, 5)]
    return np.array(values, dtype=np.uint8)
