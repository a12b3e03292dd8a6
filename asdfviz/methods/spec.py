"""The seam for methods: what one must offer, and how it makes itself known.

A method of your own, in a file of your own:

    class Mine:
        def __init__(self, config: MyConfig) -> None: ...
        def reset(self, assembly, camera, initial) -> None: ...
        def step(self, frame) -> FramePrediction: ...

    SPEC = MethodSpec("mine", "What it does.", MyConfig, f"{__name__}:Mine")

runs by `asdfviz run --method mine.py:SPEC SEQUENCE`, or by its name once a package of yours lists it
under the entry-point group `asdfviz.methods`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol, TypeAlias, runtime_checkable

from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction

Initial: TypeAlias = Literal["none", "first_frame_truth"]


@runtime_checkable
class Method(Protocol):
    """Sees frames in order and says what is in them; never sees truth but the initial pose."""

    def reset(self, assembly: Assembly, camera: Camera, initial: FramePrediction | None) -> None:
        """Get ready for a new sequence; `initial` only if the spec asks for it."""
        ...

    def step(self, frame: Frame) -> FramePrediction:
        """Say what is in the next frame; a part that was not found is absent."""
        ...


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """How a method is listed, configured and made."""

    name: str
    summary: str
    """One line for lists."""
    config: type
    """Frozen dataclass with a default for every field."""
    factory: str
    """"module:Class", imported on first use and called with the config."""
    initial: Initial = "none"
    """Whether it must be told the truth of the first frame."""
    predicts: frozenset[Literal["pose", "state"]] = frozenset({"pose", "state"})
    viewpoints: bool = False
    """Whether it tracks by viewpoint models of the parts, which take seconds a part to make once."""


@dataclass(frozen=True, slots=True)
class BrokenMethod:
    """A plug-in that could not be loaded."""

    name: str
    reason: str
