"""Keeps what drawing frees for what is drawn next."""

from __future__ import annotations

import ctypes
from functools import cache

_MMAP_THRESHOLD, _TRIM_THRESHOLD = -3, -1
"""glibc's numbers of the two settings (mallopt(3))."""
_KEPT = 1 << 30
"""Bytes: blocks up to this size, and as much at the end of the heap, are not given back."""
_ALWAYS_ALLOWED = 1 << 25
"""Bytes: the largest threshold that a glibc before 2.35 takes."""


@cache
def keep_freed_memory() -> None:
    """Let the C library keep freed memory, in this process, as long as it lives.

    A picture is drawn through hundreds of short-lived arrays of many megabytes. By default each of
    them comes from the kernel, page by page and wiped, which takes a seventh of the time. Other C
    libraries than glibc have no such setting and are left alone.
    """
    try:
        libc = ctypes.CDLL(None)
    except (OSError, TypeError):  # Windows cannot open the program itself
        return
    if hasattr(libc, "gnu_get_libc_version"):
        libc.mallopt(_TRIM_THRESHOLD, _KEPT)
        if not libc.mallopt(_MMAP_THRESHOLD, _KEPT):
            libc.mallopt(_MMAP_THRESHOLD, _ALWAYS_ALLOWED)
