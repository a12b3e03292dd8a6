"""Where the models that ship with the program lie: inside the wheel, or at the top of a clone."""

from __future__ import annotations

import os
from pathlib import Path

from asdfviz.datatypes import Assembly

_PACKAGE = Path(__file__).resolve().parent.parent
SAMPLE_ASSEMBLY = "corner_clamp"


def models_folder() -> Path:
    """The folder that holds <assembly>/assembly.yaml for every bundled assembly."""
    bundled = _PACKAGE / "_bundled" / "models"
    return bundled if bundled.is_dir() else _PACKAGE.parent / "models"


def sample_folder() -> Path:
    """The bundled sample sequence."""
    return models_folder() / SAMPLE_ASSEMBLY / "sample"


def bundled_assemblies() -> dict[str, Path]:
    """Name and assembly.yaml of every assembly that ships with the program."""
    found = sorted(models_folder().glob("*/assembly.yaml"))
    return {path.parent.name: path for path in found}


MODEL = "model"
"""Folder, in that of a scene, that may hold a copy of the scene's assembly."""


def way_to_assembly(assembly: Assembly, folder: Path) -> dict[str, str]:
    """What sequence.json in `folder` says besides the assembly's name, so that it is found again.

    Empty for what ships with the program and for what lies in no file.
    """
    file = Path(assembly.path)
    if file == bundled_assemblies().get(assembly.name) or not file.is_file():
        return {}
    try:
        way = os.path.relpath(file.parent, folder.resolve())
    except ValueError:  # on another drive of Windows
        way = str(file.parent)
    return {"assembly_path": Path(way).as_posix()}
