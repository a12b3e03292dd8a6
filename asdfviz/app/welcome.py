"""The first visit's card: five keys, then gone for good, which the browser itself remembers."""

from __future__ import annotations

from typing import Any

from asdfviz.app.markup import act, button, text

_KEY = "asdfviz-welcomed"


def is_first_visit(client: Any) -> bool:
    """Whether this browser was never told; False where it does not answer or may not remember."""
    try:
        return client.local_storage.get_item(_KEY, timeout=5.0) is None
    except (RuntimeError, TimeoutError):
        return False


def remember_visit(client: Any) -> None:
    """Do not show the card again."""
    client.local_storage.set_item(_KEY, "yes")


def card() -> str:
    """The first visit's card: the five keys that matter."""
    five = (
        ("Space", "play and pause"),
        ("← →", "step one frame, with Shift ten"),
        ("T", "the picture, or the scene in 3D"),
        ("N", "next part: then drag its arrows, or nudge with I J K L U O"),
        ("Ctrl Z", "take back any change; every change is saved at once"),
    )
    rows = "".join(f"<li><kbd>{text(k)}</kbd><span>{text(say)}</span></li>" for k, say in five)
    close = button("Got it", act("DismissWelcome"), classes="ax-primary", testid="welcome-close")
    return (
        '<div class="ax-card" role="dialog" aria-label="Welcome" data-testid="welcome">'
        "<h2>Five keys are enough to begin</h2>"
        f"<ul class='ax-keys'>{rows}</ul>"
        "<p>All keys: <kbd>?</kbd>. All commands: <kbd>Ctrl K</kbd>.</p>"
        f"<div class='ax-end'>{close}</div></div>"
    )
