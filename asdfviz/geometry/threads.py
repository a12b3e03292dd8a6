"""Runs the same work on several things at once, where most of it is in compiled loops.

Those of `jit` hold no Python lock, so threads share the cores; what is Python around them still takes turns.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor, wait
from functools import lru_cache
from typing import TypeVar

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

MOST = 4
"""Threads; more hardly help, since Python takes turns."""


def side_by_side(work: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """The results in the order of the items.

    Once all threads have ended, the error of the first item that failed is raised, as without threads;
    items that come after it may have been worked on.

    Args:
        work: does not depend on what it does for other items, and calls no `side_by_side` itself.
        items: each worked on once.
    """
    todo = list(items)
    threads = min(MOST, len(os.sched_getaffinity(0)), len(todo))
    if threads < 2:
        return [work(item) for item in todo]

    shares: list[list[_Result]] = [[] for _ in range(threads)]
    failed: dict[int, Exception] = {}

    def fill(first: int) -> None:
        for index in range(first, len(todo), threads):
            try:
                shares[first].append(work(todo[index]))
            except Exception as error:  # noqa: BLE001  raised below, once nothing runs any more
                failed[index] = error
                return

    pool = _pool(os.getpid())
    others = [pool.submit(fill, first) for first in range(1, threads)]
    fill(0)
    wait(others)
    if failed:
        raise failed[min(failed)]
    return [shares[i % threads][i // threads] for i in range(len(todo))]


@lru_cache(maxsize=1)
def _pool(process: int) -> ThreadPoolExecutor:
    """Of this process: a fork has none of its parent's threads."""
    return ThreadPoolExecutor(MOST, thread_name_prefix="side")
