"""The one tree of errors that callers can act on.

    AsdfvizError
    ├── InputError            something handed in from outside is wrong (exit code 2)
    │   ├── AssemblyError     assembly.yaml or a mesh
    │   ├── SequenceError     a scene folder, an image, a camera file, truth
    │   ├── RunError          a saved run
    │   ├── WeightsError      network weights
    │   ├── MethodError       an unknown or broken method, a wrong option
    │   └── AnnotationError   an annotation file or an edit
    ├── RenderError           OpenGL is missing or cannot be used (exit code 2)
    └── Stopped               the user asked to stop (exit code 130)

Every message says what is wrong, where (file, frame, part) and what would be right.
"""

from __future__ import annotations

from collections.abc import Iterable


class AsdfvizError(Exception):
    """Base of every error that this package raises on purpose."""


class InputError(AsdfvizError):
    """Something that came from outside is wrong; the message says what would be right."""


class AssemblyError(InputError):
    """An assembly description or one of its meshes is wrong."""


class SequenceError(InputError):
    """A scene folder, one of its images, its camera or its truth is wrong."""


class RunError(InputError):
    """A saved run is incomplete or does not fit."""


class WeightsError(InputError):
    """Network weights are missing, corrupt or do not fit the network."""


class MethodError(InputError):
    """A method is unknown, broken or was given a wrong option."""


class AnnotationError(InputError):
    """An annotation file or an edit is wrong."""


class RenderError(AsdfvizError):
    """OpenGL is missing or cannot be used here; the message says what to install."""


class Stopped(AsdfvizError):
    """The user asked a long job to stop; what was done so far is kept."""


def some(values: Iterable[object], most: int = 6, *, count: int | None = None) -> str:
    """The first of some values for a message, and how many more there are; `count` where not all are given."""
    shown = [str(value) for value in values]
    more = (len(shown) if count is None else count) - most
    return ", ".join(shown[:most]) + (f" and {more} more" if more > 0 else "")


def counted(count: int, what: str) -> str:
    """How many there are of something, whose plural ends in s: "1 frame", "3 frames"."""
    return f"{count} {what}{'' if count == 1 else 's'}"
