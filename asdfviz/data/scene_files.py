"""Finds the images of a scene folder and joins colour and depth by the number in their names."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from asdfviz.errors import SequenceError, counted, some

RGB_SUFFIXES = (".png", ".jpg", ".jpeg")
DEPTH_SUFFIXES = ((".png",), (".tif", ".tiff"), (".npy",))
"""Of depth in several kinds of files the first counts: the others are copies of it."""
_NOTES = (".csv", ".db", ".ini", ".json", ".log", ".md", ".txt", ".xml", ".yaml", ".yml")
"""What may lie beside images without being meant as one."""
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
        SequenceError: there is no scene here, it has no frames, two images share a number, or of the
            files in depth/ none is depth that can be read: going on without would mislead.
    """
    if not folder.is_dir():
        raise SequenceError(
            f"no scene folder at '{folder}'; give a folder with rgb/, depth/ and camera.json "
            "(or a BOP or GBOT scene), or the word sample"
        )
    if not (folder / "rgb").is_dir():
        raise SequenceError(f"{folder} has no folder rgb/{_colour_elsewhere(folder)}")
    rgb, odd_rgb = numbered_files(folder / "rgb", RGB_SUFFIXES)
    if not rgb:
        raise SequenceError(
            f"{folder / 'rgb'} holds no frames{_told_files(folder / 'rgb', odd_rgb)}; "
            f"{'name them' if odd_rgb else 'save them as'} 000000.png (or .jpg), 000001.png ..."
        )
    depth, odd_depth = depth_files(folder / "depth")
    files = SceneFiles(rgb=rgb, depth=depth, ignored=(*odd_rgb, *odd_depth))
    _check_depth(files, folder / "depth", odd_depth)
    return files


def _check_depth(files: SceneFiles, folder: Path, ignored: tuple[str, ...]) -> None:
    """Refuse depth of which nothing can be used: methods would go on without it in silence."""
    without = f", or take {folder.name}/ away to go on without depth"
    there = "" if files.depth else _told_files(folder, ignored)
    if there:
        raise SequenceError(
            f"{folder} holds no depth that can be used{there}; save it as 16-bit PNG (or TIFF or NPY) "
            f"under the colour images' numbers, as 000000.png{without}"
        )
    if files.depth and len(files.depth_without_rgb) == len(files.depth):
        raise SequenceError(
            f"{folder}: none of {counted(len(files.depth), 'depth image')} has the number of a colour "
            f"image (depth {some(files.depth, 3)}; colour {some(files.rgb, 3)}); number both "
            f"alike{without}"
        )


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


def _told_files(folder: Path, ignored: tuple[str, ...]) -> str:
    """What lies in a folder of which nothing was taken; empty where nothing but notes does."""
    if ignored:
        named = Path(ignored[0]).name
        return f", but {counted(len(ignored), 'image')} whose names are no numbers, as {named}"
    suffixes = Counter(
        path.suffix.lower()
        for path in (folder.iterdir() if folder.is_dir() else ())
        if path.is_file() and not path.name.startswith(".") and path.suffix.lower() not in _NOTES
    )
    if not suffixes:
        return ""
    told = some(
        counted(n, f"{suffix[1:] or 'nameless'} file") for suffix, n in suffixes.most_common()
    )
    return f", but {told}, of a kind that is not read"


def _colour_elsewhere(folder: Path) -> str:
    scenes = sorted(path.parent.name for path in folder.glob("*/rgb") if path.is_dir())
    if scenes:
        shown = ", ".join(scenes[:6]) + (" ..." if len(scenes) > 6 else "")
        return f", but scenes lie in it; open one of them: {shown}"
    rooms = [path for path in sorted(folder.iterdir()) if path.is_dir() and path.name != "depth"]
    with_pictures = [f"{room.name}/" for room in rooms if pictures_in(room)]
    there = f"; is it {' or '.join(with_pictures)}? Call it rgb" if with_pictures else ""
    return f"; a scene holds rgb/NNNNNN.png (or .jpg){there}"
