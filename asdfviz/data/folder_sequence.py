"""An RGB-D sequence that lies in a scene folder; frames are decoded when asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from asdfviz.data.cameras import CameraEntry
from asdfviz.data.images import (
    RawDepth,
    Undistorter,
    check_size,
    metric_depth,
    read_raw_depth,
    read_rgb,
)
from asdfviz.data.scene_files import SceneFiles
from asdfviz.data.truth import read_truth
from asdfviz.datatypes import Assembly, Camera, Frame, FrameTruth
from asdfviz.geometry.shapes import Depth, Rgb


@dataclass(frozen=True, slots=True)
class SceneReaders:
    """How a format's files are decoded; the default is the plain scene folder."""

    rgb: Callable[[Path], Rgb] = read_rgb
    depth: Callable[[Path], RawDepth] = read_raw_depth
    truth: Callable[[Path, Assembly], dict[int, FrameTruth]] = read_truth


PLAIN = SceneReaders()


class FolderSequence:
    """A scene folder, as `open_sequence` makes it. Reading is safe from several threads."""

    def __init__(
        self,
        folder: Path,
        files: SceneFiles,
        *,
        name: str,
        format: str,
        cameras: Mapping[int, CameraEntry],
        size_wh: tuple[int, int],
        fps: float,
        assembly: Assembly | None,
        missing_assembly: str | None = None,
        readers: SceneReaders = PLAIN,
    ) -> None:
        self.folder = folder
        self.files = files
        self.format = format
        self.cameras = cameras
        """By frame number; every frame of `files.rgb` has one."""
        self.fps = fps
        self.missing_assembly = missing_assembly
        """What sequence.json names as its assembly, where that was not found."""
        self.has_plain_files = readers is PLAIN
        """Whether colour and depth lie in image files of their own, as every BOP reader takes them."""
        self._readers = readers
        self._name = name
        self._size_wh = size_wh
        self._assembly = assembly
        self._indices = tuple(files.rgb)
        self._undistorters: dict[bytes, Undistorter] = {}

    @property
    def name(self) -> str:
        """The folder's name, or "sample"."""
        return self._name

    @property
    def path(self) -> str:
        """Absolute path of the folder."""
        return str(self.folder)

    @property
    def assembly(self) -> Assembly | None:
        """What is being assembled, where it is known."""
        return self._assembly

    @property
    def camera(self) -> Camera:
        """The camera of the first frame."""
        return self.camera_of(self._indices[0])

    @property
    def frame_indices(self) -> tuple[int, ...]:
        """The numbers in the file names, rising."""
        return self._indices

    def __len__(self) -> int:
        return len(self._indices)

    def __getitem__(self, place: int) -> Frame:
        """Decode the frame at a place.

        Raises:
            IndexError: there is no such place.
            SequenceError: an image is missing, broken, of a wrong kind or of a wrong size.
        """
        index = self._indices[place]
        return Frame(
            index=index,
            time=index / self.fps,
            rgb=self._rgb(index),
            depth=self._depth(index),
            camera=self.camera_of(index),
        )

    def truth(self, place: int) -> FrameTruth | None:
        """The truth of the frame at a place; None where there is none, or no assembly.

        Raises:
            IndexError: there is no such place.
            SequenceError: a file of the truth is broken; the message names the entry.
        """
        return self._truth.get(self._indices[place])

    def camera_of(self, index: int) -> Camera:
        """The camera of a frame by number, once its lens is undone."""
        width, height = self._size_wh
        return Camera(K=self.cameras[index].K, width=width, height=height)

    def depth_scale(self, index: int) -> float:
        """Millimetres per unit of the depth image of a frame by number."""
        scale = self.cameras[index].depth_scale
        return 1.0 if scale is None else scale

    @cached_property
    def _truth(self) -> dict[int, FrameTruth]:
        return {} if self._assembly is None else self._readers.truth(self.folder, self._assembly)

    def _rgb(self, index: int) -> Rgb:
        path = self.files.rgb[index]
        rgb = self._readers.rgb(path)
        check_size(rgb, self._size_wh, path)
        undistort = self._undistorter(self.cameras[index])
        if undistort is not None:
            rgb = undistort(rgb)
        rgb.flags.writeable = False
        return rgb

    def _depth(self, index: int) -> Depth | None:
        # Depth cameras report planar depth in an ideal pinhole image: their lens is undone already.
        path = self.files.depth.get(index)
        if path is None:
            return None
        raw = self._readers.depth(path)
        check_size(raw, self._size_wh, path)
        depth = metric_depth(raw, self.depth_scale(index))
        depth.flags.writeable = False
        return depth

    def _undistorter(self, entry: CameraEntry) -> Undistorter | None:
        if entry.distortion is None:
            return None
        key = np.ascontiguousarray(entry.K).tobytes()
        if key not in self._undistorters:
            self._undistorters[key] = Undistorter(entry.K, entry.distortion, self._size_wh)
        return self._undistorters[key]
