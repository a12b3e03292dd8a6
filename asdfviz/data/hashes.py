"""SHA-256 of what a run read, so that a later reader can tell whether it is still the same."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from asdfviz.data.scene_files import depth_files, pictures_in
from asdfviz.datatypes import Assembly

_ROOMS = ("rgb", "depth")
_AUTHORS_ROOMS = ("Images", "depth_images", "state_seg_maps", "images", "labels")


def file_sha256(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def assembly_sha256(assembly: Assembly) -> str:
    """SHA-256 over the assembly.yaml and the meshes and keypoints of its parts."""
    digest = hashlib.sha256(Path(assembly.path).read_bytes())
    for part in assembly.parts.values():
        for array in (part.mesh.vertices, part.mesh.faces, part.keypoints):
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def sequence_sha256(folder: Path) -> str:
    """SHA-256 over names and contents of a scene's images and JSON files; results beside them do not count."""
    rooms = _ROOMS if (folder / "rgb").is_dir() else _AUTHORS_ROOMS
    images = [path for room in rooms for path in pictures_in(folder / room)]
    depth = depth_files(folder / "depth")[0].values() if "depth" in rooms else ()
    known = set(images)
    images += [path for path in depth if path not in known]
    images += sorted(path for path in (folder / "labels").glob("[!.]*.txt") if "labels" in rooms)
    digest = hashlib.sha256()
    notes = sorted(path for path in folder.glob("[!.]*.json") if path.is_file())
    for file in [*notes, *images]:
        name = file.relative_to(folder).as_posix()
        digest.update(f"{name}\0{file_sha256(file)}\n".encode())
    return digest.hexdigest()
