"""Ctrl+C and SIGTERM as a polite stop, and Ctrl+C where libraries would swallow it."""

from __future__ import annotations

import _thread
import signal
import threading
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from types import FrameType


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


PATIENCE = 10.0
"""Seconds for which an import is waited for at most."""


@contextmanager
def interrupts_after_imports() -> Generator[None]:
    """Let a Ctrl+C wait while something is imported.

    Libraries take whatever an optional import raises for its absence (trimesh does so of a dozen): the
    program went on, or failed later where it missed the module. Where Ctrl+C does something else than
    to interrupt, or in another thread than the main one, nothing changes.
    """
    is_ours = threading.current_thread() is threading.main_thread()
    if not is_ours or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    latest: float | None = None
    again: threading.Timer | None = None

    def interrupt(signum: int, frame: FrameType | None) -> None:
        nonlocal latest, again
        now = time.monotonic()
        latest = now + PATIENCE if latest is None else latest
        if not _is_importing(frame) or now > latest:
            raise KeyboardInterrupt
        again = threading.Timer(0.02, _thread.interrupt_main)
        again.daemon = True
        again.start()

    signal.signal(signal.SIGINT, interrupt)
    try:
        yield
    except Exception:
        if again is not None and again.is_alive():  # asked to stop, so what failed is no news
            raise KeyboardInterrupt from None
        raise
    else:
        if again is not None and again.is_alive():  # an import that was the last thing to do
            raise KeyboardInterrupt
    finally:
        if again is not None:
            again.cancel()
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _is_importing(frame: FrameType | None) -> bool:
    while frame is not None:
        if frame.f_code.co_filename == "<frozen importlib._bootstrap>":
            return True
        frame = frame.f_back
    return False
