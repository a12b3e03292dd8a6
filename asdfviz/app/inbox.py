"""What one browser tab was asked for and has not done yet: put in from any thread, taken out by one."""

from __future__ import annotations

import queue

from asdfviz.app import actions as act


class Inbox:
    """A queue that can be woken."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[act.Action | None] = queue.SimpleQueue()

    def put(self, action: act.Action) -> None:
        """Ask for something, from any thread."""
        self._queue.put(action)

    def wake(self) -> None:
        """Let `take` return even if nobody asks for anything."""
        self._queue.put(None)

    def take(self, wait: float | None) -> list[act.Action]:
        """All that is there; waits for the first, up to so many seconds, or for good with None."""
        taken: list[act.Action] = []
        try:
            first = self._queue.get(timeout=wait) if wait != 0.0 else self._queue.get_nowait()
            while True:
                if first is not None:
                    taken.append(first)
                first = self._queue.get_nowait()
        except queue.Empty:
            return taken
