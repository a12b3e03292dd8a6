"""Keeps viewpoint models on disk, so that a part is rendered from all sides once and not each time.

A model lies in `.viewpoints` beside its assembly.yaml, or in the user's cache folder where that
cannot be written. Its name holds a hash of the mesh and of the sampling, so a changed mesh makes a
new one. Coordinates are stored as 16-bit steps of the part's size: 4 micrometres on a hand's width.
"""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from asdfviz.data.atomic import write_bytes
from asdfviz.datatypes import Assembly, Mesh, Part
from asdfviz.track.viewpoint_model import (
    ViewpointConfig,
    ViewpointModel,
    build_viewpoint_model,
    sphere_directions,
)

VERSION = 1
"""Of the file's layout and of how a view is sampled; part of the name."""
FOLDER = ".viewpoints"
_STEPS = 32767.0
_WIDEST = 60000.0
"""Greatest stored width, micrometres times ten: 0.6 m."""


def load_viewpoint_models(
    assembly: Assembly,
    *,
    config: ViewpointConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> dict[str, ViewpointModel]:
    """Return the model of every part, made where no cache has it; equal meshes share one.

    Args:
        progress: told (views done, views) over all parts that have to be made.

    Raises:
        Stopped: `stop` said so; models finished by then stay cached.
    """
    config = config or ViewpointConfig()
    views = len(sphere_directions(config.subdivisions))
    files = {name: _name(part.mesh, config) for name, part in assembly.parts.items()}
    ready = {file: _read_any(file, assembly, config) for file in files.values()}
    missing = [file for file, model in ready.items() if model is None]
    for done, file in enumerate(missing):
        part = next(assembly.parts[name] for name in files if files[name] == file)
        ready[file] = build_viewpoint_model(
            part.mesh,
            config=config,
            progress=progress
            and (lambda k, _, done=done: progress(done * views + k, len(missing) * views)),
            stop=stop,
        )
        _keep(ready[file], file, assembly)
    return {name: ready[file] for name, file in files.items()}
