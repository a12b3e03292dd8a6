"""What the weights of Pose2State are worth: runs fused anew from their own terms, without the network.

The paper names w_DL, w_P, w_f and w_{f-1} and gives no value. A run of `asdf` keeps what looks and
relative poses said in every frame; here they are fused with other weights, and by the hidden Markov
model, online (filter) and offline (Viterbi, which knows the whole recording).

What it says on the bundled sample stands in docs/figures.md: more inertia (w_f 0.2) is worth a little,
weights of the network's state boxes above 0.3 cost much as long as these are weak.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, FramePrediction, FrameTruth, StateEstimate
from asdfviz.evaluate.paper_ablations import JudgedVariant
from asdfviz.evaluate.protocols import Figures, mean
from asdfviz.evaluate.state_scores import state_figures, state_records
from asdfviz.geometry.shapes import Scores
from asdfviz.state.decoding import most_likely_path
from asdfviz.state.fusion import FusionConfig, Pose2State
from asdfviz.state.smoothing import FOLLOWED, StateFilter

Terms: TypeAlias = tuple[Scores | None, Scores | None, Scores | None]
"""By looks, by relative poses, and by what lay loose."""
TERMS = ("appearance", "relative_pose", "lately_loose")
"""What a run keeps them as."""
Fuse: TypeAlias = "Callable[[Sequence[Terms], StudiedRun], list[Scores | None]]"

W_DL = (0.0, 0.15, 0.3, 0.5, 0.7, 1.0)
"""Equation 3; w_P is what is left to 1."""
W_F = (0.2, 0.35, 0.5, 0.75, 1.0)
"""Equation 5; w_{f-1} is what is left to 1."""
NEIGHBOUR = (0.0, 0.05, 0.1, 0.2)
"""Equation 4."""


@dataclass(frozen=True, slots=True, eq=False)
class StudiedRun:
    """A run of `asdf` on one scene, and the truth."""

    assembly: Assembly
    predictions: tuple[FramePrediction, ...]
    truth: Mapping[int, FrameTruth]
    fusion: FusionConfig
    """The weights that it had."""


def fusion_study(
    runs: Sequence[StudiedRun], *, progress: Callable[[int, int], None] | None = None
) -> list[JudgedVariant]:
    """Judge each way of fusing on every run.

    Returns:
        Each term alone, Pose2State as it comes, each weight changed by itself, the best of the
        whole grid by mean macro F1 (found on these very runs, so it flatters itself), the hidden
        Markov model online and offline.
    """
    ways = dict(_ways())
    grid = {_named(config): _pose2state(lambda _, chosen=config: chosen) for config in _grid()}
    total = len(ways) + len(grid)
    judged: list[JudgedVariant] = []
    for place, (title, fuse) in enumerate(ways.items()):
        judged += [JudgedVariant(title, "", {"state": _figures(run, fuse)}) for run in runs]
        if progress is not None:
            progress(place + 1, total)
    best: tuple[float, str, list[Figures]] | None = None
    for place, (title, fuse) in enumerate(grid.items()):
        found = [_figures(run, fuse) for run in runs]
        value = mean(figures["macro_f1"] for figures in found) or 0.0
        if best is None or value > best[0]:
            best = (value, title, found)
        if progress is not None:
            progress(len(ways) + place + 1, total)
    if best is not None:
        title = f"best of {len(grid)} on these scenes: {best[1]}"
        judged += [JudgedVariant(title, "", {"state": figures}) for figures in best[2]]
    return judged


def _ways() -> Iterator[tuple[str, Fuse]]:
    yield "looks alone, frame by frame", lambda terms, _: [looks for looks, _, _ in terms]
    yield "poses alone, frame by frame", lambda terms, _: [places for _, places, _ in terms]
    yield "Pose2State as it comes", _pose2state(lambda config: config)
    yield "what lay loose may be joined", _forgetful
    for w in W_DL:
        title = f"w_DL {w:g}, w_P {1 - w:g}"
        yield title, _pose2state(lambda config, w=w: _with(config, w_dl=w))
    for w in W_F:
        title = f"w_f {w:g}, w_f-1 {1 - w:g}"
        yield title, _pose2state(lambda config, w=w: _with(config, w_f=w))
    for n in NEIGHBOUR:
        yield f"neighbour {n:g}", _pose2state(lambda config, n=n: _with(config, neighbour=n))
    yield "hidden Markov model, online", _filtered
    yield "hidden Markov model, offline", _viterbi


def _with(
    config: FusionConfig,
    *,
    w_dl: float | None = None,
    w_f: float | None = None,
    neighbour: float | None = None,
) -> FusionConfig:
    share = config.w_dl / (config.w_dl + config.w_p) if w_dl is None else w_dl
    w_f = config.w_f if w_f is None else w_f
    neighbour = config.neighbour if neighbour is None else neighbour
    return FusionConfig(share, 1 - share, w_f, 1 - w_f, neighbour)


def _grid() -> list[FusionConfig]:
    return [
        _with(FusionConfig(), w_dl=w_dl, w_f=w_f, neighbour=n)
        for w_dl, w_f, n in product(W_DL, W_F, NEIGHBOUR)
    ]


def _named(config: FusionConfig) -> str:
    return f"w_DL {config.w_dl:g}, w_f {config.w_f:g}, neighbour {config.neighbour:g}"


def _pose2state(weights: Callable[[FusionConfig], FusionConfig]) -> Fuse:
    """With other weights, by those that the run had."""

    def fuse(terms: Sequence[Terms], run: StudiedRun) -> list[Scores | None]:
        model = Pose2State(run.assembly, config=weights(run.fusion))
        said = [model.step(*said) for said in terms]
        return [None if state is None else state.probabilities for state in said]

    return fuse


def _forgetful(terms: Sequence[Terms], run: StudiedRun) -> list[Scores | None]:
    fuse = _pose2state(lambda config: config)
    return fuse([(looks, places, None) for looks, places, _ in terms], run)


def _filtered(terms: Sequence[Terms], run: StudiedRun) -> list[Scores | None]:
    model = StateFilter(run.assembly, config=FOLLOWED)
    return [model.step(looks, places, place_looks=loose) for looks, places, loose in terms]


def _viterbi(terms: Sequence[Terms], run: StudiedRun) -> list[Scores | None]:
    looks, places, loose = zip(*terms, strict=True)
    path = most_likely_path(looks, places, run.assembly, place_looks=loose, config=FOLLOWED)
    if path is None:
        return [None] * len(terms)
    return list(np.eye(len(run.assembly.states))[path])


def _figures(run: StudiedRun, fuse: Fuse) -> Figures:
    terms: list[Terms] = []
    for prediction in run.predictions:
        said = prediction.state
        if said is None:
            terms.append((None, None, None))
        else:
            looks, places, loose = (said.terms.get(name) for name in TERMS)
            terms.append((looks, places, loose))
    fused = fuse(terms, run)
    predictions = {
        old.frame_index: FramePrediction(
            old.frame_index, {}, None if belief is None else StateEstimate(belief)
        )
        for old, belief in zip(run.predictions, fused, strict=True)
    }
    truths = [run.truth[index] for index in sorted(run.truth)]
    return state_figures(state_records(truths, predictions, run.assembly))
