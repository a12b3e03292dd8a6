"""Notes over the picture: they go by themselves, what did not work stands twice as long and once."""

from __future__ import annotations

from typing import Any

MOST = 6
"""Problems and hints that stand at once: viser's page shows ten notes and keeps later ones back."""
SECONDS, PROBLEM_SECONDS = 6.0, 12.0
"""How long notes stand; problems longer, as they tell what to do instead."""


class Notes:
    """The notes of one browser tab."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self._standing: dict[tuple[str, str], Any] = {}
        """Problems and hints, oldest first; some are closed by now, which the page does not tell."""

    def tell(self, title: str, body: str, *, color: Any) -> None:
        """Show a note; one that is not green, about a problem (red) or a hint, stands there once."""
        is_once = color != "green"
        if is_once:
            self._make_room((title, body))
        note = self._client.add_notification(
            title,
            body,
            with_close_button=True,
            auto_close_seconds=PROBLEM_SECONDS if color == "red" else SECONDS,
            color=color,
        )
        if is_once:
            self._standing[title, body] = note

    def _make_room(self, note: tuple[str, str]) -> None:
        """Take the same note away, or the oldest where too many would stand."""
        gone = [note] if note in self._standing else list(self._standing)[: 1 - MOST]
        for known in gone:
            self._standing.pop(known).remove()
