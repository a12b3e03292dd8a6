"""The ASDF paper's Table 1, its test sets beside ours: parts, states and frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from asdfviz.evaluate.paper_layout import Layout, laid_out


@dataclass(frozen=True, slots=True)
class PaperAssembly:
    """One of the paper's four assemblies (Schieber et al., ISMAR 2024, Tables 1 and 4)."""

    title: str
    states: int
    frames: int
    """Of its test set."""


CORNER_CLAMP = PaperAssembly("CornerClamp", 3, 66)
SCREW_CLAMP = PaperAssembly("ScrewClamp", 10, 231)
CALIPER = PaperAssembly("GearedCaliper", 5, 111)
VISE = PaperAssembly("NanoVise", 8, 191)
PAPER_ASSEMBLIES = (CORNER_CLAMP, SCREW_CLAMP, CALIPER, VISE)
_NAMED = {
    "cornerclamp": CORNER_CLAMP,
    "screwclamp": SCREW_CLAMP,
    "caliper": CALIPER,
    "vise": VISE,
}


def counterpart(name: str) -> PaperAssembly | None:
    """The paper's assembly of the same kind, told by the name; ours are built alike, not the same."""
    plain = name.lower().replace("_", "")
    return next((theirs for part, theirs in _NAMED.items() if part in plain), None)


@dataclass(frozen=True, slots=True)
class SetFacts:
    """What is counted of one of our test sets."""

    assembly: str
    name: str
    parts: int
    states: int
    """Correct ones."""
    errors: int
    """Error states that the assembly knows."""
    frames: int
    width: int
    height: int
    error_frames: int
    """In which an error state is there."""


HEADINGS = (
    "Assembly",
    "Set",
    "Paper's",
    "paper states",
    "paper frames",
    "parts",
    "states",
    "error states",
    "frames",
    "with an error",
    "width",
    "height",
)


def table1(sets: Sequence[SetFacts], *, layout: Layout = "markdown") -> str:
    """Lay out one row a set; the paper's figures stand beside its Table 1 sets alone."""
    rows: list[list[str]] = []
    for one in sets:
        theirs = counterpart(one.assembly) if one.name == "table1" else None
        counts = (one.parts, one.states, one.errors, one.frames, one.error_frames)
        rows.append(
            [
                one.assembly,
                one.name,
                "-" if theirs is None else theirs.title,
                "-" if theirs is None else str(theirs.states),
                "-" if theirs is None else str(theirs.frames),
                *(str(n) for n in (*counts, one.width, one.height)),
            ]
        )
    return laid_out(HEADINGS, rows, texts=3, layout=layout)
