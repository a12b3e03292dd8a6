"""Keeps viewpoint models on disk, so that a part is rendered from all sides once and not each time.

A model lies in `.viewpoints` beside its assembly.yaml, or in the user's cache folder where that
cannot be written. Its name holds a hash of the mesh and of the sampling, so a changed mesh makes a
new one. Coordinates are stored as 16-bit steps of the part's size: 4 micrometres on a hand's width.
A model that was just made is handed out as its file tells it, so that a second run repeats the first.
"""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from asdfviz.data.atomic import write_bytes
from asdfviz.data.kept_arrays import unpacked, user_cache_folder
from asdfviz.datatypes import Assembly, Mesh
from asdfviz.track.viewpoint_model import (
    ViewpointConfig,
    ViewpointModel,
    build_viewpoint_model,
)

VERSION = 2
"""Of the file's layout and of how a view is sampled; part of the name."""
FOLDER = ".viewpoints"
_STEPS = 32767.0
_OFFSET_STEP = np.float32(0.0005)
"""Step of a stored depth offset, metres; they end at 0.13 m."""


def load_viewpoint_models(
    assembly: Assembly,
    *,
    config: ViewpointConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[str, ViewpointModel]:
    """Return the model of every part, made where no cache has it; equal meshes share one.

    `progress` is told (views done, views) over all parts that have to be made.

    Raises:
        Stopped: `stop` said so; models finished by then stay cached.
    """
    config = config or ViewpointConfig()
    files = {name: _file_name(part.mesh, config) for name, part in assembly.parts.items()}
    parts = {files[name]: part for name, part in assembly.parts.items()}
    ready = {file: _read_any(_places(assembly, file)) for file in parts}
    missing = [file for file, model in ready.items() if model is None]
    views = 10 * 4**config.subdivisions + 2
    for done, file in enumerate(missing):

        def tell(k: int, _: int, before: int = done * views) -> None:
            if progress is not None:
                progress(before + k, len(missing) * views)

        model = build_viewpoint_model(parts[file].mesh, config=config, progress=tell, stop=stop)
        packed = pack_viewpoint_model(model)
        _keep(packed, _places(assembly, file))
        ready[file] = unpack_viewpoint_model(packed)
    return {name: model for name, file in files.items() if (model := ready[file]) is not None}


def pack_viewpoint_model(model: ViewpointModel) -> bytes:
    """The content of a model's .npz file: positions and offsets in steps, as the module says."""
    reach = float(max(np.abs(model.contours[..., :3]).max(), np.abs(model.surfaces[..., :3]).max()))
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        centre=model.centre,
        reach=np.array(reach),
        directions=model.directions,
        contours=_coded(model.contours[..., :6], reach),
        widths=np.minimum(model.contours[..., 6:] * 1e3, 6e4).astype(np.float16),
        contour_lengths=model.contour_lengths,
        contour_offsets=_coded_offsets(model.contour_offsets),
        surfaces=_coded(model.surfaces[..., :6], reach),
        edges=(model.surfaces[..., 6:] * 1e3).astype(np.float16),
        surface_areas=model.surface_areas,
        surface_offsets=_coded_offsets(model.surface_offsets),
        occlusion_radii=np.array(model.occlusion_radii),
    )
    return buffer.getvalue()


def unpack_viewpoint_model(packed: bytes) -> ViewpointModel:
    """Make a model of what `pack_viewpoint_model` wrote.

    Raises:
        OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile: it is something else.
    """
    held = unpacked(packed)
    reach = float(held["reach"])
    widths = held["widths"].astype(np.float32) / 1e3
    edges = held["edges"].astype(np.float32) / 1e3
    return ViewpointModel(
        centre=held["centre"],
        directions=held["directions"],
        contours=np.concatenate([_decoded(held["contours"], reach), widths], axis=2),
        contour_lengths=held["contour_lengths"],
        contour_offsets=held["contour_offsets"].astype(np.float32) * _OFFSET_STEP,
        surfaces=np.concatenate([_decoded(held["surfaces"], reach), edges], axis=2),
        surface_areas=held["surface_areas"],
        surface_offsets=held["surface_offsets"].astype(np.float32) * _OFFSET_STEP,
        occlusion_radii=tuple(held["occlusion_radii"].tolist()),
    )


def read_viewpoint_model(path: Path) -> ViewpointModel | None:
    """Read a model back; None where there is none, or a file that is not one."""
    try:
        return unpack_viewpoint_model(path.read_bytes())
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return None


def _file_name(mesh: Mesh, config: ViewpointConfig) -> str:
    """The name says all that the content depends on."""
    digest = hashlib.sha256(f"{VERSION} {astuple(config)}".encode())
    digest.update(np.ascontiguousarray(mesh.vertices).tobytes())
    digest.update(np.ascontiguousarray(mesh.faces).tobytes())
    return f"{digest.hexdigest()[:24]}.npz"


def _places(assembly: Assembly, file: str) -> tuple[Path, Path]:
    return Path(assembly.path).parent / FOLDER / file, user_cache_folder("viewpoints") / file


def _read_any(places: tuple[Path, ...]) -> ViewpointModel | None:
    found = (read_viewpoint_model(place) for place in places)
    return next((model for model in found if model is not None), None)


def _keep(packed: bytes, places: tuple[Path, ...]) -> None:
    """Write to the first place that can be written; a cache that cannot be kept is no error."""
    for place in places:
        try:
            write_bytes(place, packed)
        except OSError:
            continue
        return


def _coded(points: Float32[np.ndarray, "v n 6"], reach: float) -> np.ndarray:
    """Positions in steps of the part's size, then normals: 16 bits each."""
    steps = points[..., :3] * (_STEPS / reach)
    return np.concatenate([steps, points[..., 3:] * _STEPS], axis=2).round().astype(np.int16)


def _decoded(coded: np.ndarray, reach: float) -> Float32[np.ndarray, "v n 6"]:
    points = coded.astype(np.float32) / np.float32(_STEPS)
    points[..., :3] *= np.float32(reach)
    return points


def _coded_offsets(offsets: Float32[np.ndarray, "v n r"]) -> np.ndarray:
    """Whole steps, rounded up: an offset that is too small would hide the part behind itself."""
    return np.minimum(np.ceil(offsets / _OFFSET_STEP), 255).astype(np.uint8)
