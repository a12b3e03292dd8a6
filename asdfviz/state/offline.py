"""The followed states of a whole recording decoded anew, from the terms that a run keeps of every frame.

Transitions and evidence are those of the online filter; only its future is known besides. What stood
in places and what was seen of the group was asked with the online state in view, and stays as it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import StateEstimate
from asdfviz.geometry.shapes import Scores
from asdfviz.state.decoding import most_likely_path
from asdfviz.state.half_done import HalfDone
from asdfviz.state.smoothing import SmoothingConfig, StateFilter

FrameTerms: TypeAlias = tuple[Scores | None, Scores | None, Scores | None, Scores | None]
"""By looks, relative poses, the group's fit and what stands in places: as `StateFilter.step` takes them."""
ROUNDING = 1e-6
"""By this probabilities of the same model may differ."""


@dataclass(frozen=True, slots=True, eq=False)
class FollowedTerms:
    """What the terms said in every frame of a recording, and the model that joins them."""

    ways: HalfDone
    config: SmoothingConfig
    frames: tuple[FrameTerms, ...]

    @classmethod
    def of(
        cls, said: Sequence[StateEstimate | None], ways: HalfDone, *, config: SmoothingConfig
    ) -> FollowedTerms | None:
        """Gather the terms of a run; None where it does not keep what is needed.

        Args:
            said: of every frame; None where nothing was ever seen before.
            ways: the states that the model has.
            config: the model.
        """
        frames = tuple(_frame_terms(one, ways) for one in said)
        known = tuple(frame for frame in frames if frame is not None)
        if len(known) < len(frames) or all(term is None for frame in known for term in frame):
            return None
        return cls(ways, config, known)

    def online(self) -> list[Scores | None]:
        """Probabilities of the assembly's own states by the filter, as it first gave them."""
        model = StateFilter(self.ways.assembly, config=self.config, half_done=self.ways.indices)
        beliefs = [model.step(*terms) for terms in self.frames]
        return [None if belief is None else self.ways.summed(belief) for belief in beliefs]

    def gave(self, said: Sequence[StateEstimate | None]) -> bool:
        """Whether the filter gives these probabilities, but for rounding."""
        return all(
            (one is None) == (belief is None)
            and (one is None or belief is None or _alike(one.probabilities, belief))
            for one, belief in zip(said, self.online(), strict=True)
        )

    def offline(self) -> list[int]:
        """The assembly's own state in every frame, all frames known."""
        looks, places, fits, stands = zip(*self.frames, strict=True)
        path = most_likely_path(
            looks,
            places,
            self.ways.assembly,
            group_fit=fits,
            place_looks=stands,
            config=self.config,
            half_done=self.ways.indices,
            counts_to=self.ways.before,
        )
        assert path is not None  # some frame says something
        return path


def _frame_terms(said: StateEstimate | None, ways: HalfDone) -> FrameTerms | None:
    """None where a term lacks states that the model has, or is not finite."""
    if said is None:
        return None, None, None, None
    terms = said.unfolded if ways.indices else said.terms
    looks, own = said.terms.get("appearance"), len(ways.before) - len(ways.indices)
    others = [name for name in ("relative_pose", "group_fit", "place_looks") if name in said.terms]
    kept = {name: terms[name] for name in others if name in terms}
    if len(kept) < len(others) or not all(_is_of(t, len(ways.before)) for t in kept.values()):
        return None
    if looks is not None and not _is_of(looks, own):
        return None
    return (
        ways.unfolded(looks),
        kept.get("relative_pose"),
        kept.get("group_fit"),
        kept.get("place_looks"),
    )


def _is_of(term: Scores, states: int) -> bool:
    return len(term) == states and bool(np.isfinite(term).all())


def _alike(one: Scores, other: Scores) -> bool:
    return one.shape == other.shape and bool(np.allclose(one, other, rtol=0.0, atol=ROUNDING))
