"""Opens a scene folder as a sequence, recognised by what lies in it.

    folder   rgb/NNNNNN.{png,jpg,jpeg}, depth/NNNNNN.{png,tif,tiff,npy} (uint16), camera.json
    bop      the same images, scene_camera.json, scene_gt.json with numbers as obj_id
    gbot     the same images, scene_camera.json, scene_gt.json with names as obj_id
    asdf     Images/, depth_images/, state_seg_maps/: the ASDF authors' raw renderings, one camera
    asdf-rgbd  images/ (16-bit colour and depth in one), labels/: the ASDF authors' training export

camera.json may accompany any of them (size, `distortion`), as may states.json (the truth of the
states), unchecked.json (by frame, parts without a pose that may be there) and sequence.json ({"assembly": name or relative path, "fps": 30}; "assembly_path" may tell
where the one of that name lies, from the folder, and model/ there may hold a copy of it).
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from asdfviz.data import asdf_raw, asdf_rgbd
from asdfviz.data.assembly import load_assembly
from asdfviz.data.cameras import CameraEntry, read_camera_file, read_scene_cameras
from asdfviz.data.folder_sequence import PLAIN, FolderSequence, SceneReaders
from asdfviz.data.images import read_rgb
from asdfviz.data.json_files import Json, read_json
from asdfviz.data.path_names import check_name
from asdfviz.data.resources import MODEL, bundled_assemblies, sample_folder
from asdfviz.data.scene_files import SceneFiles, find_scene_files
from asdfviz.data.scene_objects import id_kind
from asdfviz.datatypes import Assembly, FrameTruth
from asdfviz.errors import SequenceError

FORMATS = ("folder", "bop", "gbot", "asdf", "asdf-rgbd")
SAMPLE = "sample"
DEFAULT_FPS = 30.0

_CAMERA, _SCENE_CAMERA, _SEQUENCE = "camera.json", "scene_camera.json", "sequence.json"
_READERS = {"asdf": asdf_raw.READERS, "asdf-rgbd": asdf_rgbd.READERS}
_FILES = {"asdf": asdf_raw.find_raw_files, "asdf-rgbd": asdf_rgbd.find_rgbd_files}
"""Formats that are laid out otherwise; all others are plain scene folders."""

DRAWN = ("scenes", "packs")
"""Kinds of images, in sequence.json, that repeat parts so that detectors learn them."""


def open_sequence(
    path: str | Path, *, assembly: Assembly | None = None, format: str | None = None
) -> FolderSequence:
    """Open a scene folder, or the bundled sequence for the word "sample". No image is kept in memory.

    Args:
        path: the scene folder, or "sample" (a folder of that name is "./sample").
        assembly: what is being assembled; without it, sequence.json may name it.
        format: one of `FORMATS`, to override what the content says.

    Raises:
        SequenceError: there is no scene, no frame, no camera, the format does not fit, or the
            folder's name is no text.
        AssemblyError: the assembly that sequence.json names is broken.
    """
    if format is not None and format not in FORMATS:
        raise SequenceError(f"unknown format '{format}'; formats: {', '.join(FORMATS)}")
    is_sample = str(path) == SAMPLE
    folder = (sample_folder() if is_sample else Path(path).expanduser()).resolve()
    check_name(folder, error=SequenceError)
    kind = _layout(folder) if format is None else format
    files = _FILES.get(kind, find_scene_files)(folder)
    if kind not in _READERS:
        kind = _recognise(folder) if format is None else _confirmed(folder, format)
    cameras = _cameras(folder, files, kind)
    about = _about(folder)
    missing = None
    if assembly is None:
        assembly, missing = _named_assembly(folder, about)
    return FolderSequence(
        folder,
        files,
        name=SAMPLE if is_sample else folder.name,
        format=kind,
        cameras=cameras,
        size_wh=_size(files, cameras),
        fps=_fps(about),
        assembly=assembly,
        missing_assembly=missing,
        readers=_READERS.get(kind, PLAIN),
    )


def read_folder_truth(folder: Path, assembly: Assembly) -> dict[int, FrameTruth]:
    """Read the truth of a folder of any format, by frame number; empty where it holds none.

    Raises:
        SequenceError: a file of the truth is broken; the message names the entry.
    """
    readers: SceneReaders = _READERS.get(_layout(folder), PLAIN)
    return readers.truth(folder, assembly)


def shows_drawn_copies(folder: Path) -> bool:
    """Whether these are images to train with, in which `asdfviz synth` drew parts more than once."""
    about = _about(folder)
    kind = None if about is None else about.find("kind")
    return kind is not None and kind.value in DRAWN


def _layout(folder: Path) -> str:
    """Tell the authors' layouts from a plain scene folder by the rooms in it."""
    if (folder / "rgb").is_dir():
        return "folder"
    if asdf_raw.is_raw_scene(folder):
        return "asdf"
    if asdf_rgbd.is_rgbd_scene(folder):
        return "asdf-rgbd"
    scenes = asdf_raw.raw_scenes_below(folder)
    if scenes:
        shown = ", ".join(str(scene.relative_to(folder)) for scene in scenes[:6])
        raise SequenceError(
            f"{folder} holds several cameras; open one of them: {shown}"
            f"{' ...' if len(scenes) > 6 else ''}"
        )
    return "folder"


def _recognise(folder: Path) -> str:
    kind = id_kind(folder)
    if kind is not None:
        return "bop" if kind is int else "gbot"
    if (folder / _SCENE_CAMERA).is_file():
        return "bop"
    if (folder / _CAMERA).is_file():
        return "folder"
    raise SequenceError(
        f"{folder} has no camera file; add camera.json with fx, fy, cx, cy, width, height and "
        "depth_scale (millimetres per unit), or BOP's scene_camera.json"
    )


def _confirmed(folder: Path, format: str) -> str:
    """Check that a format that was asked for is possible here."""
    kind = id_kind(folder)
    expected = {"bop": int, "gbot": str}.get(format)
    if expected is not None and kind is not None and kind is not expected:
        other = "gbot" if kind is str else "bop"
        raise SequenceError(
            f"{folder} is not of format '{format}': the obj_ids of scene_gt.json are "
            f"{'names' if kind is str else 'numbers'}; use '{other}'"
        )
    return format


def _cameras(folder: Path, files: SceneFiles, kind: str) -> dict[int, CameraEntry]:
    """The camera of every frame; scene_camera.json goes before camera.json, which adds the lens."""
    common = _common_camera(folder, kind)
    by_frame = folder / _SCENE_CAMERA
    fallback = read_camera_file(common) if common.is_file() else None
    if kind != "folder" and by_frame.is_file():
        given = read_scene_cameras(by_frame)
        return {i: _merged(given.get(i), fallback, i, by_frame) for i in files.rgb}
    if fallback is None:
        others = "" if kind == "folder" else f" and no {_SCENE_CAMERA}"
        others += " (in no folder above either)" if kind in _READERS else ""
        raise SequenceError(
            f"{folder} has no {_CAMERA}{others}; add it with fx, fy, cx, cy, width, height and "
            "depth_scale (millimetres per unit)"
        )
    return dict.fromkeys(files.rgb, fallback)


def _common_camera(folder: Path, kind: str) -> Path:
    """camera.json of the folder; in the authors' layouts one camera may stand above many scenes."""
    above = list(folder.parents)[: asdf_rgbd.FOLDERS_ABOVE] if kind in _READERS else []
    files = [place / _CAMERA for place in (folder, *above)]
    return next((file for file in files if file.is_file()), files[0])


def _merged(
    entry: CameraEntry | None, fallback: CameraEntry | None, index: int, file: Path
) -> CameraEntry:
    if entry is None and fallback is None:
        raise SequenceError(f"{file} has no entry '{index}', but there is a colour image of it")
    if entry is None or fallback is None:
        return entry or fallback  # pyright: ignore[reportReturnType]  # one of them is there
    return replace(
        entry,
        depth_scale=fallback.depth_scale if entry.depth_scale is None else entry.depth_scale,
        size_wh=entry.size_wh or fallback.size_wh,
        distortion=fallback.distortion,
    )


def _size(files: SceneFiles, cameras: dict[int, CameraEntry]) -> tuple[int, int]:
    index, path = next(iter(files.rgb.items()))
    given = cameras[index].size_wh
    if given is not None:
        return given
    height, width = read_rgb(path).shape[:2]
    return width, height


def _about(folder: Path) -> Json | None:
    file = folder / _SEQUENCE
    return read_json(file, error=SequenceError) if file.is_file() else None


def _fps(about: Json | None) -> float:
    field = None if about is None else about.find("fps")
    if field is None:
        return DEFAULT_FPS
    fps = field.number()
    if fps < 0:
        raise field.fail("frames per second, or 0 for single images")
    return fps or DEFAULT_FPS


def _named_assembly(folder: Path, about: Json | None) -> tuple[Assembly | None, str | None]:
    """Load what sequence.json names; where it is not found, return its name as the second value."""
    if about is None or (field := about.find("assembly")) is None:
        return None, None
    name, way = field.text(), about.find("assembly_path")
    told = None if way is None else folder / way.text()
    for candidate in (told, folder / MODEL, bundled_assemblies().get(name), folder / name):
        if candidate is not None and _is_assembly(candidate):
            return load_assembly(candidate), None
    return None, name


def _is_assembly(path: Path) -> bool:
    return path.is_file() or (path / "assembly.yaml").is_file()
