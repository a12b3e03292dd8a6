"""How work in the background shows: a bar with a way out while it runs, a line when it has ended."""

from __future__ import annotations

from collections.abc import Mapping

from asdfviz.app.items import JobStatus
from asdfviz.app.markup import text


def running(job: JobStatus, doing: str, *, control: str, testid: str, pace: str = "") -> str:
    """The bar as HTML.

    Args:
        job: how far it is.
        doing: what it does, plain text.
        control: the button that ends it, HTML.
        testid: of the box.
        pace: said after the counts, plain text.
    """
    share = 100 * job.done / job.total if job.total else 0.0
    return (
        f'<div class="ax-jobbox" data-testid="{testid}"><div class="ax-row">'
        f"<span>{text(doing)}: {job.done}/{job.total}{text(pace)}</span>{control}</div>"
        f'<span class="ax-meter"><i style="width:{share:.1f}%"></i></span></div>'
    )


def ended(job: JobStatus, words: Mapping[str, str], *, testid: str, control: str = "") -> str:
    """The line as HTML; `words` holds plain text for the states that a job ends in, `control` a button."""
    kind = {"done": "ax-good", "failed": "ax-bad"}.get(job.state, "ax-note")
    kind = "ax-doubt" if job.state == "done" and job.message else kind
    return f'<p class="{kind}" data-testid="{testid}">{text(words[job.state])}{control}</p>'
