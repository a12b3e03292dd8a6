"""The log of a run: one CSV line an interval, and the picture drawn from it."""

from __future__ import annotations

import csv
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from torch import Tensor

from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.data.encoding import encoded

LossValues: TypeAlias = Float[Tensor, "n"]

COLORS = ((0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (213, 94, 0), (80, 80, 80))
"""Okabe and Ito's, RGB."""


class Meter:
    """Means of the losses since it was made."""

    def __init__(self) -> None:
        self.steps, self.inputs, self.objects = 0, 0, 0
        self._began = time.monotonic()
        self._sum: Tensor | None = None

    def add(self, losses: LossValues, inputs: int, objects: int) -> None:
        """Count one step."""
        self._sum = losses if self._sum is None else self._sum + losses
        self.steps += 1
        self.inputs += inputs
        self.objects += objects

    def means(self) -> list[float]:
        """Mean of each loss over the steps; empty before the first."""
        return [] if self._sum is None else [float(v) / self.steps for v in self._sum]

    @property
    def inputs_per_s(self) -> float:
        """Speed since it was made."""
        return self.inputs / max(time.monotonic() - self._began, 1e-9)


class CsvLog:
    """Appends lines to a CSV file; a resumed run goes on in the same file, with new columns too."""

    def __init__(self, path: Path, columns: Sequence[str], *, step: int) -> None:
        """Begin a file, or go on in one.

        Args:
            path: the file.
            columns: their names, the first of them "step"; those that the file has already stay.
            step: that the run goes on from; rows of later ones, whose work was lost, go.
        """
        self.path = path
        if not path.is_file():
            self.columns = tuple(columns)
            write_text(path, ",".join(self.columns) + "\n")
            return
        head, *rows = path.read_text(encoding="utf-8").splitlines(keepends=True)
        had = head.rstrip("\n").split(",")
        self.columns = tuple(dict.fromkeys((*had, *columns)))
        last = float(_cell(float(step)))
        kept = [row for row in rows if row.endswith("\n") and float(row.split(",")[0]) <= last]
        empty = "," * (len(self.columns) - len(had))
        if kept != rows or empty:
            padded = (row.rstrip("\n") + empty + "\n" for row in kept)
            write_text(path, "".join((",".join(self.columns) + "\n", *padded)))

    def add(self, values: Mapping[str, float]) -> None:
        """Append one line; a value that is missing stays empty."""
        with self.path.open("a", encoding="utf-8", newline="") as file:
            csv.writer(file).writerow(
                [_cell(values[c]) if c in values else "" for c in self.columns]
            )

    def read(self) -> dict[str, list[float]]:
        """Return the columns; empty cells are NaN."""
        with self.path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
        return {
            c: [float(row[c]) if row[c] else float("nan") for row in rows] for c in self.columns
        }


def _cell(value: float) -> str:
    return f"{value:.6g}"


def write_curve(path: Path, log: CsvLog, *, x: str, curves: Sequence[str], note: str = "") -> None:
    """Draw columns of a log over another one, each scaled to its own largest value.

    Args:
        path: a .png to write.
        log: where the columns are.
        x: name of the column along the bottom.
        curves: names of the others.
        note: a line under them.
    """
    picture = draw_curves(log.read(), x=x, curves=curves, note=note)
    write_bytes(path, encoded(picture[:, :, ::-1]))


def draw_curves(
    columns: Mapping[str, Sequence[float]], *, x: str, curves: Sequence[str], note: str = ""
) -> UInt8[np.ndarray, "h w 3"]:
    """Return the picture of `write_curve` (RGB)."""
    width, height, margin = 900, 480, 50
    canvas = np.full((height, width, 3), 255, np.uint8)
    cv2.rectangle(canvas, (margin, margin), (width - margin, height - margin), (200, 200, 200), 1)
    across = np.asarray(columns[x], float)
    span = float(across.max()) if across.size else 1.0
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(canvas, f"{x} 0 to {span:.3g}", (margin, height - 18), font, 0.5, (60, 60, 60), 1)
    cv2.putText(canvas, note, (margin + 190, height - 18), font, 0.42, (60, 60, 60), 1, cv2.LINE_AA)
    for place, name in enumerate(curves):
        color = COLORS[place % len(COLORS)]
        values = np.asarray(columns[name], float)
        known = np.isfinite(values)
        top = float(np.percentile(values[known], 98)) if known.any() else 1.0
        top = top if top > 0 else 1.0
        u = margin + across[known] / max(span, 1e-9) * (width - 2 * margin)
        v = height - margin - np.clip(values[known] / top, 0, 1) * (height - 2 * margin)
        line = np.stack([u, v], axis=1).round().astype(np.int32)
        cv2.polylines(canvas, [line[:, None]], False, color, 2, cv2.LINE_AA)
        text = f"{name} (top {top:.3g})"
        cv2.putText(canvas, text, (margin + place * 140, 30), font, 0.42, color, 1, cv2.LINE_AA)
    return canvas
