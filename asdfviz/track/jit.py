"""Compiles the tracker's inner loops, in which sums may be reordered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from asdfviz.geometry.jit import compiled

# Sums may be reordered and multiplied-added in one step; infinities and NaN keep their meaning.
_FAST = {"reassoc", "contract", "arcp", "nsz"}


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """`compiled` as a decorator, with these liberties; it goes above `@no_type_check`."""
    return compiled(function, fastmath=_FAST)
