"""Compiles the tracker's inner loops with numba: one thread, cached on disk, no Python lock held."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from numba import njit

# Sums may be reordered and multiplied-added in one step; infinities and NaN keep their meaning.
_FAST = {"reassoc", "contract", "arcp", "nsz"}


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function of arrays and numbers on its first call.

    Put it above `@no_type_check`: the compiler needs the bare function, which shape checking at
    run time would otherwise wrap. numba's cache looks at the file of the function alone, so a
    kernel calls only kernels of its own file, or such as hardly change.
    """
    compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath=_FAST)(function)
    return cast(Callable[..., Any], compiled)
