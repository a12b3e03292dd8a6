"""Runs the tracker on a recorded sequence, beside the poses and times that M3T has on it.

A folder holds color/NNNN.png, depth/NNNN.png (16 bit, metres = value * depth_scale), meta.json
(fu fv ppu ppv width height n depth_scale), mesh.obj (metres), gt.txt and init.txt (a row-major 4x4
T_camera_part a line), and may hold init_pert.txt and m3t_<mode>/obj_poses.txt with times.csv.
"""

from __future__ import annotations

import csv
import json
import os
import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from asdfviz.data.meshes import read_mesh
from asdfviz.datatypes import Camera, Frame, Mesh
from asdfviz.errors import SequenceError
from asdfviz.geometry.shapes import Transform, Transforms
from asdfviz.geometry.transforms import rotation_angle
from asdfviz.track.bodies import Body, centre_of_mass
from asdfviz.track.presets import PRESETS, TrackerConfig
from asdfviz.track.tracker import Tracker
from asdfviz.track.viewpoint_model import ViewpointConfig, build_viewpoint_model

REFERENCES = {"region": "m3t_region_rbot", "depth": "m3t_depth_ycb", "icg": "m3t_icg_ycb"}
"""Mode, which is the preset's name too, and the folder with M3T's results of the same settings."""
SETTLED = 20
"""First frame that counts after a perturbed start."""


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A sequence of one part with its truth."""

    frames: tuple[Frame, ...]
    mesh: Mesh
    truth: Transforms
    start: Transform
    perturbed: Transform | None
    folder: Path

    @property
    def camera(self) -> Camera:
        """The camera of all frames."""
        return self.frames[0].camera


def read_recording(folder: Path) -> Recording:
    """Read a folder of the module's layout.

    Raises:
        SequenceError: a file is missing or wrong.
    """
    try:
        meta = json.loads((folder / "meta.json").read_text(encoding="utf-8"))
        K = np.array(
            [[meta["fu"], 0.0, meta["ppu"]], [0.0, meta["fv"], meta["ppv"]], [0.0, 0.0, 1.0]]
        )
        camera = Camera(K, int(meta["width"]), int(meta["height"]))
        count, scale = int(meta["n"]), float(meta["depth_scale"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SequenceError(f"{folder / 'meta.json'} is missing or wrong: {error}") from error
    truth = read_poses(folder / "gt.txt")
    if not 0 < count <= len(truth):
        raise SequenceError(f"{folder}: meta.json says {count} frames, gt.txt has {len(truth)}")
    perturbed = folder / "init_pert.txt"
    return Recording(
        frames=tuple(_read_frame(folder, i, camera, scale) for i in range(count)),
        mesh=read_mesh(folder / "mesh.obj", unit="m", part="mesh.obj"),
        truth=truth[:count],
        start=read_poses(folder / "init.txt")[0],
        perturbed=read_poses(perturbed)[0] if perturbed.is_file() else None,
        folder=folder,
    )


def read_poses(path: Path) -> Transforms:
    """Read row-major 4x4 matrices from a text file, however its lines are broken.

    Raises:
        SequenceError: the file is missing or holds something else.
    """
    try:
        numbers = np.array(path.read_text(encoding="utf-8").split(), np.float64)
        return numbers.reshape(-1, 4, 4)
    except (OSError, ValueError) as error:
        raise SequenceError(f"{path} holds no 4x4 poses: {error}") from error


def _read_frame(folder: Path, index: int, camera: Camera, scale: float) -> Frame:
    color, depth = folder / "color" / f"{index:04d}.png", folder / "depth" / f"{index:04d}.png"
    bgr = cv2.imread(str(color), cv2.IMREAD_COLOR)
    raw = cv2.imread(str(depth), cv2.IMREAD_UNCHANGED)
    for path, image in ((color, bgr), (depth, raw)):
        if image is None or image.shape[:2] != (camera.height, camera.width):
            raise SequenceError(f"{path} is missing or not {camera.width}x{camera.height}")
    rgb = np.ascontiguousarray(np.asarray(bgr, np.uint8)[:, :, ::-1])
    metres = np.asarray(raw, np.float32) * np.float32(scale)
    return Frame(index, index / 30, rgb, metres, camera)


@dataclass(frozen=True, slots=True)
class ModeResult:
    """One mode's figures on a recording and M3T's beside them; None = the folder does not tell."""

    add_mm_median: float
    add_mm_max: float
    rot_deg_median: float
    ms_median: float
    """Tracking alone, the images being in memory; the best of several runs."""
    m3t_add_mm_median: float | None
    m3t_add_mm_max: float | None
    m3t_rot_deg_median: float | None
    m3t_ms_median: float | None
    settled_add_mm_median: float | None
    """Of frames 20 on, from the true start."""
    perturbed_add_mm_median: float | None
    """Of the same frames, from the perturbed start."""
    load: float
    """Of the machine in the last minute: above its number of cores, times are too long."""


JSON_KEYS = (
    "add_mm_median",
    "add_mm_max",
    "rot_deg_median",
    "ms_median",
    "m3t_add_mm_median",
    "m3t_ms_median",
)


def bench_track(folder: str | Path, *, runs: int = 5) -> dict[str, dict[str, float | None]]:
    """Return what `asdfviz bench track --json` prints: JSON_KEYS by mode (see `measure`)."""
    return json_report(measure(folder, runs=runs))


def json_report(results: Mapping[str, ModeResult]) -> dict[str, dict[str, float | None]]:
    """The figures of JSON_KEYS, mode by mode."""
    return {mode: {k: getattr(row, k) for k in JSON_KEYS} for mode, row in results.items()}


def measure(
    folder: str | Path, *, runs: int = 5, views: ViewpointConfig | None = None
) -> dict[str, ModeResult]:
    """Track a recording in every mode from its true start, each `runs` times for the time.

    `views` is how finely the part is sampled.

    Raises:
        SequenceError: the folder is not of the module's layout.
    """
    recording = read_recording(Path(folder))
    model = build_viewpoint_model(recording.mesh, config=views)
    body = Body(
        recording.mesh, model, np.zeros(3, np.uint8), balance=centre_of_mass(recording.mesh)
    )
    return {
        mode: _measure_mode(recording, body, PRESETS[mode], reference, runs)
        for mode, reference in REFERENCES.items()
    }


def _measure_mode(
    recording: Recording, body: Body, config: TrackerConfig, reference: str, runs: int
) -> ModeResult:
    track(recording, body, config, recording.start, frames=2)
    tracked = [track(recording, body, config, recording.start) for _ in range(runs)]
    add, rot = errors(recording, tracked[0][0])
    perturbed = None
    if recording.perturbed is not None:
        poses, _ = track(recording, body, config, recording.perturbed)
        perturbed = _settled(errors(recording, poses)[0])
    m3t_add, m3t_rot = _reference_errors(recording, recording.folder / reference)
    return ModeResult(
        add_mm_median=float(np.median(add)),
        add_mm_max=float(add.max()),
        rot_deg_median=float(np.median(rot)),
        ms_median=min(statistics.median(ms) for _, ms in tracked),
        m3t_add_mm_median=None if m3t_add is None else float(np.median(m3t_add)),
        m3t_add_mm_max=None if m3t_add is None else float(m3t_add.max()),
        m3t_rot_deg_median=None if m3t_rot is None else float(np.median(m3t_rot)),
        m3t_ms_median=_reference_ms(recording.folder / reference / "times.csv"),
        settled_add_mm_median=_settled(add),
        perturbed_add_mm_median=perturbed,
        load=os.getloadavg()[0],
    )


def track(
    recording: Recording,
    body: Body,
    config: TrackerConfig,
    T_camera_part: Transform,
    *,
    frames: int | None = None,
) -> tuple[Transforms, list[float]]:
    """Track from a pose of the first frame on; return poses and milliseconds, frame by frame."""
    tracker = Tracker({"part": body}, recording.camera, config)
    tracker.start(recording.frames[0], {"part": T_camera_part})
    poses: list[Transform] = []
    ms: list[float] = []
    for frame in recording.frames[:frames]:
        begun = time.perf_counter()
        tracked = tracker.update(frame)
        ms.append((time.perf_counter() - begun) * 1e3)
        poses.append(tracked["part"])
    return np.stack(poses), ms


def errors(recording: Recording, poses: Transforms) -> tuple[np.ndarray, np.ndarray]:
    """ADD over the mesh's vertices (mm) and rotation error (degrees), frame by frame."""
    add: list[float] = []
    rot: list[float] = []
    for T, T_truth in zip(poses, recording.truth, strict=False):
        moved = recording.mesh.vertices @ (T - T_truth)[:3, :3].T + (T - T_truth)[:3, 3]
        add.append(float(np.linalg.norm(moved, axis=1).mean()) * 1e3)
        rot.append(float(np.rad2deg(rotation_angle(T_truth[:3, :3].T @ T[:3, :3]))))
    return np.array(add), np.array(rot)


def _settled(add: np.ndarray) -> float | None:
    return float(np.median(add[SETTLED:])) if len(add) > SETTLED else None


def _reference_errors(
    recording: Recording, folder: Path
) -> tuple[np.ndarray, np.ndarray] | tuple[None, None]:
    """M3T's own errors, None where its folder is absent."""
    path = folder / "obj_poses.txt"
    return errors(recording, read_poses(path)) if path.is_file() else (None, None)


def _reference_ms(path: Path) -> float | None:
    if not path.is_file():
        return None
    try:
        with path.open(newline="", encoding="utf-8") as file:
            return statistics.median(float(line["track_ms"]) for line in csv.DictReader(file))
    except (ValueError, KeyError) as error:
        raise SequenceError(f"{path} has no times in a column 'track_ms': {error}") from error


def bench_table(results: Mapping[str, ModeResult]) -> str:
    """Lay the results out as text: ours, M3T's and their ratio, mode by mode."""
    columns: tuple[tuple[str, str], ...] = (
        ("ADD median mm", "add_mm_median"),
        ("ADD max mm", "add_mm_max"),
        ("rotation deg", "rot_deg_median"),
        ("ms a frame", "ms_median"),
    )
    lines = [f"{'mode':8}{'':6}" + "".join(f"{title:>16}" for title, _ in columns)]
    for mode, row in results.items():
        ours = [getattr(row, key) for _, key in columns]
        theirs = [getattr(row, f"m3t_{key}") for _, key in columns]
        ratios = [a / b if b else None for a, b in zip(ours, theirs, strict=True)]
        for name, values in (("ours", ours), ("M3T", theirs), ("ratio", ratios)):
            cells = "".join(f"{'-' if v is None else f'{v:.2f}':>16}" for v in values)
            lines.append(f"{mode if name == 'ours' else '':8}{name:6}{cells}")
        perturbed, settled = row.perturbed_add_mm_median, row.settled_add_mm_median
        if perturbed is not None and settled:
            lines.append(
                f"{'':14}from frame {SETTLED} on: {perturbed:.2f} mm after a perturbed start, "
                f"{settled:.2f} mm after the true one ({perturbed / settled:.2f})"
            )
        lines.append(f"{'':14}load of the machine {row.load:.1f}; initial: first_frame_truth")
    return "\n".join(lines)
