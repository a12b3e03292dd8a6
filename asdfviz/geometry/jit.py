"""Compiles inner loops with numba: one thread, cached on disk, no Python lock held."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any, cast

from numba import njit


def compiled(function: Callable[..., Any], *, fastmath: Collection[str] = ()) -> Callable[..., Any]:
    """Compile a function of arrays and numbers on its first call.

    numba's cache looks at the file of the function alone, so it calls only compiled functions of
    its own file, or such as hardly change.

    Args:
        function: bare, as `@no_type_check` leaves it: shape checking at run time would wrap it.
        fastmath: LLVM's names of the liberties that sums may take; none by default.
    """
    made = njit(cache=True, nogil=True, error_model="numpy", fastmath=set(fastmath))(function)
    return cast(Callable[..., Any], made)


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """`compiled` as a decorator, with exact arithmetic; it goes above `@no_type_check`."""
    return compiled(function)
