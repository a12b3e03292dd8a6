"""How a page shows what it shows, and what it tells when it comes back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Tab = Literal["sequence", "methods", "annotate", "results"]
Mode = Literal["ar", "3d"]
Gizmo = Literal["move", "turn", "off"]
Switch = Literal["overlay", "xray", "boxes", "keypoints", "together"]


@dataclass(frozen=True, slots=True)
class Resume:
    """Go on where the page was before it was loaded again, or before its connection was lost."""

    place: int
    mode: Mode
    page: str = ""
    """The name that it had (`View.page`); its steps of undo go on being its own."""
    tab: Tab = "sequence"
    selected: str | None = None
    base: str | None = None
    """The run (or the truth) that a person chose; None where nobody did."""
    zoom: float = 1.0
    centre: tuple[float, float] | None = None
    """Pixel in the middle of the AR view; None for straight ahead."""
    opacity: float = 0.65
    step: int = 1
    gizmo: Gizmo = "move"
    speed: float = 1.0
    on: tuple[Switch, ...] = ("overlay",)
    """The switches that were on."""
    hidden: tuple[str, ...] = ()
    layers: tuple[str, ...] = ()
