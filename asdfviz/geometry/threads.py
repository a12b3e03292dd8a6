"""Runs the same work on several things at once, where most of it is in compiled loops.

Those of `jit` hold no Python lock, so threads share the cores; what is Python around them still takes turns.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

MOST = 4
"""Threads; more hardly help, since Python takes turns."""


def side_by_side(work: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """The results in the order of the items. The first error is raised, as without threads.

    Args:
        work: does not depend on what it does for other items, and calls no `side_by_side` itself.
        items: each worked on once.
    """
    todo = list(items)
    threads = min(MOST, len(os.sched_getaffinity(0)), len(todo))
    if threads < 2:
        return [work(item) for item in todo]

    def share(first: int) -> list[_Result]:
        return [work(item) for item in todo[first::threads]]

    pool = _pool(os.getpid())
    others = [pool.submit(share, first) for first in range(1, threads)]
    shares = [share(0), *(other.result() for other in others)]
    return [shares[i % threads][i // threads] for i in range(len(todo))]


@lru_cache(maxsize=1)
def _pool(process: int) -> ThreadPoolExecutor:
    """Of this process: a fork has none of its parent's threads."""
    return ThreadPoolExecutor(MOST, thread_name_prefix="side")
