"""Notes over the picture: what went well goes by itself, what did not stays until it is closed."""

from __future__ import annotations

from typing import Any

MOST = 6
"""Problems that stand at once: viser's page shows ten notes and keeps later ones back."""
_SECONDS = 6.0


class Notes:
    """The notes of one browser tab."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._standing: dict[tuple[str, str], Any] = {}
        """Problems, oldest first; some may be closed by now, which the page does not tell."""

    def tell(self, title: str, body: str, *, color: Any) -> None:
        """Show a note; a red one, about a problem, stays until it is closed, and stands there once."""
        is_problem = color == "red"
        if is_problem:
            self._make_room((title, body))
        note = self._client.add_notification(
            title,
            body,
            with_close_button=True,
            auto_close_seconds=None if is_problem else _SECONDS,
            color=color,
        )
        if is_problem:
            self._standing[title, body] = note

    def _make_room(self, problem: tuple[str, str]) -> None:
        """Take the same problem away, or the oldest where too many would stand."""
        gone = [problem] if problem in self._standing else list(self._standing)[: 1 - MOST]
        for known in gone:
            self._standing.pop(known).remove()
