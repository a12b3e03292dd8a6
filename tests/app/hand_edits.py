"""Where edits of the tests are made: the clamp's jaw, in one frame or in a marked range."""

from __future__ import annotations

from collections.abc import Callable

from asdfviz.app.desk import Done
from asdfviz.app.view import View

JAW = View(place=1, base="first", selected="jaw")
RANGE = View(place=3, base="first", selected="jaw", marked=(2, 4))
Do = Callable[..., Done]
"""Takes an edit, a view (JAW unless told) and the time `now`, seconds."""
