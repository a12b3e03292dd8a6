"""A progress bar on stderr, and Ctrl+C and SIGTERM as a polite stop."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

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


@contextmanager
def stop_on_interrupt() -> Generator[Callable[[], bool]]:
    """Turn the first Ctrl+C or SIGTERM into a flag that long jobs poll; a second Ctrl+C interrupts at once.

    Batch queues and shutdowns send SIGTERM, some of them to every process and again by its parent:
    however often it comes, what was begun is saved.
    """
    asked = False

    def ask(signum: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked and signum == signal.SIGINT:
            raise KeyboardInterrupt
        asked = True

    before = {kind: signal.signal(kind, ask) for kind in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield lambda: asked
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


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
