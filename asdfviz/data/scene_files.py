"""Finds the images of a scene folder and joins colour and depth by the number in their names."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from asdfviz.errors import SequenceError

RGB_SUFFIXES = (".png", ".jpg", ".jpeg")
DEPTH_SUFFIXES = ((".png",), (".tif", ".tiff"), (".npy",))
"""Of depth in several kinds of files the first counts: the others are copies of it."""
COLOUR_FOLDERS = ("rgb", "Images", "images")
"""Where formats keep colour: ours and BOP's, the ASDF authors' renderings, their training export."""


@dataclass(frozen=True, slots=True)
class SceneFiles:
    """The images of a scene by frame number."""

    rgb: dict[int, Path]
    depth: dict[int, Path]
    ignored: tuple[str, ...]
    """Images whose names are not numbers, relative to the folder."""

    @property
    def depth_without_rgb(self) -> tuple[int, ...]:
        """Numbers of depth images that no colour image goes with."""
        return tuple(sorted(self.depth.keys() - self.rgb.keys()))

    @property
    def rgb_without_depth(self) -> tuple[int, ...]:
        """Numbers of colour images that no depth image goes with."""
        return tuple(sorted(self.rgb.keys() - self.depth.keys()))


def find_scene_files(folder: Path) -> SceneFiles:
    """List rgb/NNNNNN.{png,jpg,jpeg} and depth/NNNNNN.png, or .tif, .tiff or .npy where there is no PNG.

    Raises:
        SequenceError: there is no scene here, it has no frames, or two images share a number.
    """
    if not folder.is_dir():
        raise SequenceError(
            f"no scene folder at '{folder}'; give a folder with rgb/, depth/ and camera.json "
            "(or a BOP or GBOT scene), or the word sample"
        )
    if not (folder / "rgb").is_dir():
        raise SequenceError(f"{folder} has no folder rgb/{_scenes_below(folder)}")
    rgb, odd_rgb = numbered_files(folder / "rgb", RGB_SUFFIXES)
    if not rgb:
        raise SequenceError(
            f"{folder / 'rgb'} holds no frames; name them 000000.png (or .jpg), 000001.png ..."
        )
    depth, odd_depth = depth_files(folder / "depth")
    return SceneFiles(rgb=rgb, depth=depth, ignored=(*odd_rgb, *odd_depth))


def pictures_in(folder: Path) -> list[Path]:
    """The PNGs and JPEGs of a folder by name, whatever else lies there; none where there is no folder."""
    return [
        path
        for path in sorted(folder.glob("*.*"))
        if path.suffix.lower() in RGB_SUFFIXES and not path.name.startswith(".") and path.is_file()
    ]


def depth_files(folder: Path) -> tuple[dict[int, Path], tuple[str, ...]]:
    """List a folder's depth images by the number in their names, rising, and those whose names are none.

    Raises:
        SequenceError: the folder is a file, or two files of one kind share a number.
    """
    ignored: list[str] = []
    for suffixes in DEPTH_SUFFIXES:
        numbered, odd = numbered_files(folder, suffixes)
        ignored += odd
        if numbered:
            return numbered, tuple(ignored)
    return {}, tuple(ignored)


def numbered_files(
    folder: Path, suffixes: tuple[str, ...]
) -> tuple[dict[int, Path], tuple[str, ...]]:
    """List a folder's files by the number in their names, rising, and those whose names are none.

    Raises:
        SequenceError: the folder is a file, or two files share a number.
    """
    if folder.exists() and not folder.is_dir():
        raise SequenceError(f"{folder} is a file; it must be a folder with images")
    numbered: dict[int, Path] = {}
    ignored: list[str] = []
    for path in sorted(folder.iterdir()) if folder.is_dir() else ():
        if path.suffix.lower() not in suffixes or path.name.startswith("."):
            continue
        if not (path.stem.isascii() and path.stem.isdigit()):
            ignored.append(f"{folder.name}/{path.name}")
            continue
        number = int(path.stem)
        if number in numbered:
            raise SequenceError(
                f"{folder}: {numbered[number].name} and {path.name} are both frame {number}; "
                "keep one"
            )
        numbered[number] = path
    return dict(sorted(numbered.items())), tuple(ignored)


def _scenes_below(folder: Path) -> str:
    scenes = sorted(path.parent.name for path in folder.glob("*/rgb") if path.is_dir())
    if not scenes:
        return "; a scene holds rgb/NNNNNN.png (or .jpg)"
    shown = ", ".join(scenes[:6]) + (" ..." if len(scenes) > 6 else "")
    return f", but scenes lie in it; open one of them: {shown}"
