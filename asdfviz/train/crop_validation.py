"""How good a crop network's rotations are: on crops of its own kind and on parts in scenes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
import torch
from jaxtyping import Float64

from asdfviz.detector.crop_answer import REACH
from asdfviz.detector.crop_classes import CropClass
from asdfviz.detector.crop_network import CropNetwork
from asdfviz.geometry.rotation_grid import angles_of, even_rotations, highest_mode
from asdfviz.train.crop_views import ViewMaker, Views

NEAR_DEG = 25.0
"""A rotation this near to the truth counts as found."""
BEST = (1, 5, 20)


@dataclass(frozen=True, slots=True)
class CropScore:
    """Figures of one part class; symmetric poses count as equal."""

    label: str
    crops: int
    found: tuple[float, ...]
    """Share with a grid rotation within 25 degrees among the best 1, 5 and 20."""
    best_deg: float
    """Median error of the best grid rotation."""
    mean_deg: float
    """Median error of the strongest peak's mean."""
    outline: float
    """Mean intersection over union of the visible outline; NaN for scenes, which have none."""
    place: float
    """Median error of the middle, as a share of the crop's side."""
    state: float
    """Share of crops whose most probable state is right; NaN for parts."""
    named: float
    """Share of crops that are named right; NaN for groups."""


@dataclass(frozen=True, slots=True)
class CropValidation:
    """Figures of a network on one set."""

    name: str
    classes: tuple[CropScore, ...]
    nothing: float
    """Share of crops of nothing known that are named so; NaN without any."""

    @property
    def name_right(self) -> float:
        """Mean over part classes of the share of crops that are named right."""
        known = [c.named for c in self.classes if not math.isnan(c.named)]
        return float(np.mean(known)) if known else math.nan

    @property
    def score(self) -> float:
        """0 to 1: mean over classes of the share found by the best and by the best five."""
        return float(np.mean([(c.found[0] + c.found[1]) / 2 for c in self.classes] or [math.nan]))

    @property
    def state(self) -> float:
        """Mean over groups of the share of crops whose state is right; NaN where none is shown."""
        known = [c.state for c in self.classes if not math.isnan(c.state)]
        return float(np.mean(known)) if known else math.nan

    def as_json(self) -> dict[str, object]:
        """Plain numbers and lists; None for what is not known."""
        return {
            "name": self.name,
            "score": self.score,
            "state": _known(self.state),
            "named": _known(self.name_right),
            "nothing": _known(self.nothing),
            "classes": [{k: _known(v) for k, v in asdict(c).items()} for c in self.classes],
        }

    def table(self) -> str:
        """One line a class, for people."""
        lines = [
            f"{self.name}: score {self.score:.3f}",
            f"{'class':<46}{'n':>5}{'1':>6}{'5':>6}{'20':>6}{'best':>7}{'mean':>7}{'iou':>6}{'place':>7}"
            f"{'state':>7}{'named':>7}",
        ]
        for c in (*self.classes, self._overall()):
            shares = "".join(f"{100 * f:>6.0f}" for f in c.found)
            lines.append(
                f"{c.label:<46}{c.crops:>5}{shares}{c.best_deg:>7.1f}{c.mean_deg:>7.1f}"
                f"{c.outline:>6.2f}{c.place:>7.3f}{c.state:>7.2f}{c.named:>7.2f}"
            )
        lines.append(f"{'nothing known, named so':<46}{self.nothing:>7.2f}")
        return "\n".join(lines)

    def _overall(self) -> CropScore:
        rows = [(*c.found, c.best_deg, c.mean_deg, c.outline, c.place) for c in self.classes]
        values = [float(v) for v in np.mean(np.array(rows), axis=0)]
        count = len(BEST)
        total = sum(c.crops for c in self.classes)
        found, others = tuple(values[:count]), values[count:]
        return CropScore(
            "mean over classes", total, found, *others, state=self.state, named=self.name_right
        )


def validate_crops(
    network: CropNetwork,
    views: Sequence[Views],
    maker: ViewMaker,
    classes: Sequence[CropClass],
    *,
    name: str,
) -> CropValidation:
    """Run a network in evaluation mode on batches of views."""
    rows: dict[int, list[Float64[np.ndarray, "f"]]] = {}
    nothing: list[bool] = []
    grid = even_rotations(network.grid)
    for batch in views:
        with torch.inference_mode():
            out, names = (
                network(batch.pictures, batch.labels),
                network.names(batch.pictures, batch.sizes),
            )
            probabilities = out.rotations.float().softmax(1)
            angles = torch.rad2deg(maker.angles(batch.quaternions, batch.labels))
            ranked = angles.gather(1, probabilities.topk(BEST[-1], dim=1).indices).cpu().numpy()
            drawn, true = out.outline.float() > 0, batch.outline > 0.5
            union = (drawn | true).sum((1, 2)).clamp(min=1)
            outline = ((drawn & true).sum((1, 2)) / union).cpu().numpy()
            place = (out.place.float() - batch.place)[:, :2].square().sum(
                1
            ).sqrt().cpu().numpy() / 2
            if bool(batch.outline.isnan().any()):
                outline = outline * np.nan
            said = maker.own_states(out.states.float(), batch.labels).argmax(1)
            right = torch.where(batch.states < 0, torch.nan, (said == batch.states).float())
        called = names.float().argmax(1) if names.shape[1] else batch.names - 1
        named = torch.where(batch.names < 0, torch.nan, (called == batch.names).float())
        quaternions = batch.quaternions.double().cpu().numpy()
        labels = batch.labels.cpu().numpy()
        for i, label in enumerate(int(v) for v in labels):
            if int(batch.names[i]) == maker.nothing:
                nothing.append(bool(named[i] > 0))
                continue
            peak = highest_mode(probabilities[i].double().cpu().numpy(), grid, reach=REACH)
            close = classes[label].equivalents.closeness(quaternions[i], peak)
            error = float(np.rad2deg(angles_of(close))[0])
            found = [float(ranked[i, :k].min() < NEAR_DEG) for k in BEST]
            figures = [
                *found,
                ranked[i, 0],
                error,
                outline[i],
                place[i],
                float(right[i]),
                float(named[i]),
            ]
            row = np.array(figures, np.float64)
            rows.setdefault(label, []).append(row)
    scores = [_score(classes[label].name, np.stack(rows[label])) for label in sorted(rows)]
    return CropValidation(name, tuple(scores), float(np.mean(nothing)) if nothing else math.nan)


def _known(value: object) -> object:
    """None instead of NaN, which JSON has not."""
    return None if isinstance(value, float) and math.isnan(value) else value


def _score(label: str, rows: Float64[np.ndarray, "n f"]) -> CropScore:
    count = len(BEST)
    return CropScore(
        label,
        len(rows),
        tuple(float(v) for v in rows[:, :count].mean(axis=0)),
        best_deg=float(np.median(rows[:, count])),
        mean_deg=float(np.median(rows[:, count + 1])),
        outline=float(rows[:, count + 2].mean()),
        place=float(np.median(rows[:, count + 3])),
        state=float(rows[:, count + 4].mean()),
        named=float(rows[:, count + 5].mean()),
    )
