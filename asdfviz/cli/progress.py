"""A progress bar on stderr."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from asdfviz.data.interrupts import stop_on_interrupt as stop_on_interrupt

Report = Callable[[int, int, str], None]
"""Done, total, what to say beside the bar."""


@contextmanager
def progress_bar(title: str) -> Generator[Report]:
    """Show a bar on stderr while the body runs; call the yielded function to move it.

    A bar that was never moved vanishes in the end, so that an error at the start stands alone.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task(title, total=None, note="")

    def report(done: int, total: int, note: str = "") -> None:
        bar.live.transient = False
        bar.start()
        bar.update(task, completed=done, total=total, note=note)

    if bar.console.is_terminal:
        bar.start()
    try:
        yield report
    finally:
        if bar.live.is_started:
            bar.stop()


def with_rate(report: Report, unit: str) -> Callable[[int, int], None]:
    """Report progress with the pace of what this call made, without what lay there before."""
    begun: tuple[int, float] | None = None

    def tell(done: int, total: int) -> None:
        nonlocal begun
        now = time.perf_counter()
        if begun is None:
            begun = (done, now)
        made, seconds = done - begun[0], now - begun[1]
        report(done, total, f"{made / seconds:.2f} {unit}/s" if made and seconds else "")

    return tell
