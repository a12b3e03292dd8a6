"""Changes viser's handles only where something differs: every assignment is a message to the page."""

from __future__ import annotations

from typing import Any

import numpy as np

from asdfviz.app.drawings import wxyz_of
from asdfviz.geometry.shapes import Transform


def put(handle: Any, name: str, value: object) -> None:
    """Set a property."""
    if getattr(handle, name) != value:
        setattr(handle, name, value)


def move(handle: Any, T: Transform) -> None:
    """Bring what hangs in the scene to a pose."""
    position = T[:3, 3]
    wxyz = wxyz_of(T[:3, :3])
    if not np.array_equal(handle.position, position):
        handle.position = position
    if not np.array_equal(handle.wxyz, wxyz):
        handle.wxyz = wxyz
