"""Which browser tabs are open, by the names that their steps of undo bear.

Every connection gets a name of its own. A page whose connection was lost comes back with a new one
and tells the one that it had: its earlier steps are its own still, and no other tab's to undo.
"""

from __future__ import annotations

import re
import secrets
import threading

_NAME = re.compile(r"[0-9a-f]{8}")


class Pages:
    """The names of all tabs; may be asked from any thread."""

    def __init__(self) -> None:
        self._open: dict[str, set[str]] = {}
        """By the name of each connection, all names that its page has had."""
        self._left: dict[str, set[str]] = {}
        """The same of those that were closed, by each of their names."""
        self._waiting: dict[str, str] = {}
        """By the name of a connection the one before it, which has not been closed yet."""
        self._lock = threading.Lock()

    def open(self) -> str:
        """Name a new connection."""
        name = secrets.token_hex(4)
        with self._lock:
            self._open[name] = {name}
        return name

    def go_on(self, name: str, earlier: str) -> None:
        """Let a page have what it did by an earlier name, too.

        While another connection has that name nothing happens: it may be another page's. It may also
        be the page's own, of whose loss nobody heard yet; so once it is closed, the page has it.

        Args:
            name: of its connection.
            earlier: as the page tells it; what cannot be a name is ignored.
        """
        with self._lock:
            if name not in self._open or not _NAME.fullmatch(earlier):
                return
            held = set[str]().union(*(names for key, names in self._open.items() if key != name))
            if earlier in held:
                self._waiting[name] = earlier
            else:
                # A part of these may have gone to another page since.
                self._open[name] |= self._left.pop(earlier, {earlier}) - held

    def close(self, name: str) -> None:
        """The connection has gone; its names are for the page that waits for one of them."""
        with self._lock:
            self._waiting.pop(name, None)
            names = self._open.pop(name, set())
            heirs = [heir for heir, earlier in self._waiting.items() if earlier in names]
            if heirs:
                self._open[heirs[-1]] |= names
                del self._waiting[heirs[-1]]
            else:
                self._left.update(dict.fromkeys(names, names))

    def others(self, name: str) -> set[str]:
        """The names of all open tabs but this one."""
        with self._lock:
            own = self._open.get(name, {name})
            return set[str]().union(*self._open.values()) - own
