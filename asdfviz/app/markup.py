"""Small pieces of HTML. Every string that comes from data goes through `text`. Pure."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence

from asdfviz.app.theme import Rgb3, css


def text(value: object) -> str:
    """Escape for HTML text and attributes."""
    return html.escape(str(value), quote=True)


def act(kind: str, **fields: object) -> str:
    """Attributes that make an element send an action when it is pressed."""
    return f'data-act="{text(json.dumps({"kind": kind, **fields}))}" role="button" tabindex="0"'


def mount(slot: str, content: str, **data: object) -> str:
    """Content that the page's script shows in a place outside the panel."""
    fields = "".join(f' data-{key}="{text(value)}"' for key, value in data.items())
    return f'<template data-asdf-mount="{text(slot)}"{fields}>{content}</template>'


def button(
    label: str,
    action: str,
    *,
    title: str = "",
    key: str = "",
    classes: str = "",
    testid: str = "",
    pressed: bool | None = None,
) -> str:
    """A button; `action` comes from `act`, `key` is shown as its shortcut, `label` is text or a picture.

    Its accessible name begins with the word that is seen, which is what people say to voice control.
    """
    hint = f"{title} ({key})" if key and title else title or key
    state = "" if pressed is None else f' aria-pressed="{str(pressed).lower()}"'
    test = f' data-testid="{text(testid)}"' if testid else ""
    aria = f' title="{text(hint)}"' if hint else ""
    seen = "" if label.startswith("<") or title.startswith(label) else f"{label}: "
    name = f' aria-label="{text(seen + title)}"' if title else ""
    return f'<span class="ax-btn {classes}" {action}{state}{test}{aria}{name}>{label}</span>'


EYE = (
    '<svg viewBox="0 0 16 16"><path d="M8 3.5C4.5 3.5 2 8 2 8s2.5 4.5 6 4.5S14 8 14 8s-2.5-4.5'
    '-6-4.5zm0 7.5a3 3 0 110-6 3 3 0 010 6zm0-1.5a1.5 1.5 0 100-3 1.5 1.5 0 000 3z"/></svg>'
)


def chip(color: Rgb3, *, shape: str = "square", other: Rgb3 | None = None) -> str:
    """A small patch of colour beside a name; its lower right half in the other colour, if there is one."""
    both = f"linear-gradient(135deg,{css(color)} 50%,{css(other or color)} 50%)"
    return f'<i class="ax-chip ax-{shape}" style="background:{both if other else css(color)}"></i>'


def bar(share: float, color: Rgb3) -> str:
    """A horizontal bar, 0 to 1."""
    return (
        f'<span class="ax-bar"><i style="width:{100 * min(max(share, 0.0), 1.0):.1f}%;'
        f'background:{css(color)}"></i></span>'
    )


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, classes: str = "") -> str:
    """A table; the first column is text, the others are figures. Cells are HTML, heads are text."""
    top = "".join(f"<th>{text(cell)}</th>" for cell in head)
    body = "".join("<tr>" + "".join(f"<td>{cell}</td>" for cell in row) + "</tr>" for row in rows)
    thead = f"<thead><tr>{top}</tr></thead>" if head else ""
    return f'<table class="ax-table {classes}">{thead}<tbody>{body}</tbody></table>'


def heading(label: str, extra: str = "") -> str:
    """A section's small heading; `extra` is HTML at its right end."""
    return f'<h3 class="ax-h"><span>{text(label)}</span>{extra}</h3>'


def empty(message: str) -> str:
    """What stands where there is nothing yet."""
    return f'<p class="ax-empty">{text(message)}</p>'


def number(value: float | None, *, decimals: int, unit: str = "") -> str:
    """A figure with fixed decimals; a dash where there is none, never NaN."""
    if value is None or value != value:
        return "\u2013"
    shown = fixed(value, decimals=decimals).replace("-", "\u2212")
    return f"{shown}<small> {text(unit)}</small>" if unit else shown


def fixed(value: float, *, decimals: int) -> str:
    """The same bare, as it may be typed."""
    # Adding zero turns a rounded -0.0 into 0.0.
    return f"{round(value, decimals) + 0.0:.{decimals}f}"
