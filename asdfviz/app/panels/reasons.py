"""What spoke for which state in the frame on show, term by term, of the run that is drawn."""

from __future__ import annotations

import numpy as np

from asdfviz.app.markup import chip, heading, number, table, text
from asdfviz.app.snapshot import Snapshot
from asdfviz.app.timeline import color_of, mark_of_state
from asdfviz.datatypes import Assembly, State, StateEstimate
from asdfviz.geometry.shapes import Scores

MOST = 4
"""Of the likeliest states so many have a column."""
LEAST = 0.005
"""Less likely ones by all terms have none."""
_NAMES = {
    "appearance": ("looks", "How the parts look that are joined, to the networks"),
    "relative_pose": ("poses", "Where the parts are, seen from the base"),
    "group_fit": (
        "whole group",
        "What the camera sees of all that each state joins, drawn together",
    ),
    "place_looks": (
        "places",
        "What stands where each state joins a part, and what still lies loose",
    ),
    "lately_loose": ("lay loose", "What was loose so lately that it cannot be joined yet"),
    "previous": ("frame before", "What was told in the frame before, and may follow it"),
}


def section(snap: Snapshot) -> str:
    """As HTML; nothing where the run says no state or keeps no terms."""
    said = snap.prediction.state if snap.prediction else None
    if said is None or not said.terms:
        return ""
    assembly = snap.workspace.assembly
    states = _shown(said, assembly)
    head = ["", *(str(state.completed) + "!" * state.is_error for state in states)]
    marks = [mark_of_state(assembly, state.index) for state in states]
    steps = len(assembly.steps)
    chips = [f'<span title="{text(m.name)}">{chip(color_of(m, steps))}</span>' for m in marks]
    rows = [["", *chips]]
    rows += [_row(name, term, states) for name, term in said.terms.items()]
    rows.append(["<b>together</b>", *_cells(said.probabilities, states)])
    told = assembly.states[said.index].name
    return (
        heading(f"Why {told}")
        + f'<div data-testid="reasons">{table(head, rows, classes="ax-reasons")}</div>'
        + '<p class="ax-note">How likely each term alone has the states of this frame; ! is an error.</p>'
    )


def _shown(said: StateEstimate, assembly: Assembly) -> list[State]:
    """The likeliest states, by all terms and by any, in the assembly's order."""
    strongest = np.max([said.probabilities, *said.terms.values()], axis=0)
    # What is told has a column, whatever the terms say.
    order = sorted(assembly.states, key=lambda s: (s.index != said.index, -strongest[s.index]))
    kept = [s for s in order[:MOST] if strongest[s.index] >= LEAST]
    return sorted(kept, key=lambda s: (s.completed, s.is_error, s.index))


def _row(name: str, term: Scores, states: list[State]) -> list[str]:
    label, meaning = _NAMES.get(name, (name, name))
    return [
        f'<span title="{text(meaning)}">{text(label)}</span>',
        *_cells(term, states),
    ]


def _cells(scores: Scores, states: list[State]) -> list[str]:
    """In percent, what is likeliest standing out."""
    shares = [100.0 * float(scores[state.index] / max(scores.sum(), 1e-12)) for state in states]
    shown = [number(share, decimals=0, unit="%") for share in shares]
    return [
        f"<b>{cell}</b>" if share == max(shares) else cell
        for cell, share in zip(shown, shares, strict=True)
    ]
