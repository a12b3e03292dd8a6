"""A sequence for tests that need no files."""

from __future__ import annotations

from dataclasses import dataclass

from asdfviz.datatypes import Assembly, Camera, Frame, FrameTruth


@dataclass(frozen=True)
class MemorySequence:
    """Frames in memory; the folder it points to holds no truth files."""

    frames: tuple[Frame, ...]
    truths: tuple[FrameTruth | None, ...]
    assembly: Assembly | None
    path: str
    name: str = "memory"

    @property
    def camera(self) -> Camera:
        return self.frames[0].camera

    @property
    def frame_indices(self) -> tuple[int, ...]:
        return tuple(frame.index for frame in self.frames)

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, place: int) -> Frame:
        return self.frames[place]

    def truth(self, place: int) -> FrameTruth | None:
        return self.truths[place]
