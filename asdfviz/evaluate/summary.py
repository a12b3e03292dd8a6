"""Means over several runs: plain, and weighted by frames, for each method and each assembly of it.

The paper's means are plain means over assemblies in its main tables and weighted ones in its ablation,
as far as its figures tell, so both are given.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from asdfviz.evaluate.offline_states import OFFLINE
from asdfviz.evaluate.protocols import Figures

SECTIONS = ("mean", "state", OFFLINE)
DECODED = "offline (Viterbi)"
"""What states are called that were decoded with all frames known."""
HELD = "n_frames_in_run"
"""Key of a report: how many of its frames the run holds; only there where that is not all of them."""
START = "start"
"""Key of a report and heading of a table: what the method began with, TRUTH or "none"."""
TRUTH = "truth"
GIVEN = (
    "Methods whose start is 'truth' were handed the true poses of the first frame, as in the paper, "
    "and are not judged on it"
)
"""What to say below a table in which there are such."""


def summaries(reports: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Average what `evaluate_run` returned for several runs of one protocol.

    Returns:
        For each method one entry for each assembly that it ran on (if more than one) and one for
        all ("assembly": None): {"method", "start", "assembly", "n_runs", "n_frames", "plain":
        {"mean": ..., "state": ...}, "frame_weighted": the same}, and HELD where runs lack frames. A
        figure that a run leaves undefined does not count in it; one that all leave undefined is None.
        States decoded offline have means where all runs of the entry have them.
    """
    found: list[dict[str, Any]] = []
    for method in dict.fromkeys(report["method"] for report in reports):
        own = [report for report in reports if report["method"] == method]
        assemblies = list(dict.fromkeys(report["assembly"] for report in own))
        groups = assemblies if len(assemblies) > 1 else []
        found += [
            _summary(method, name, [r for r in own if r["assembly"] == name]) for name in groups
        ]
        found.append(_summary(method, None, own))
    return found


def with_offline(rows: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Reports or means as rows of a table; below each that has states decoded offline these alone."""
    for row in rows:
        yield row
        if OFFLINE in row:
            nothing: Figures = {}
            apart = {"mean": nothing, "state": row[OFFLINE], "runtime_ms": nothing}
            yield {**row, **apart, "method": f"{row['method']}, {DECODED}"}


def start_told(initials: Iterable[str]) -> str:
    """What runs began with, by `Run.initial`: TRUTH if any of them was given the first frame's."""
    return TRUTH if "first_frame_truth" in initials else "none"


def starts_differ(reports: Iterable[Mapping[str, Any]]) -> bool:
    """Whether a table has to say what its runs began with: not where all began with nothing."""
    return any(report[START] == TRUTH for report in reports)


def frames_told(report: Mapping[str, Any]) -> str:
    """How many frames count, and before them how many of these the run holds where it lacks some."""
    total = str(report["n_frames"])
    return f"{report[HELD]}/{total}" if HELD in report else total


def frames_lacking(reports: Sequence[Mapping[str, Any]]) -> str:
    """What a table without a column of frames says of a mean over runs that lack some; else nothing."""
    if not any(HELD in report for report in reports):
        return ""
    held = sum(int(report.get(HELD, report["n_frames"])) for report in reports)
    return f" ({held}/{sum(int(report['n_frames']) for report in reports)} frames)"


def _summary(
    method: str, assembly: str | None, reports: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    frames = [int(report["n_frames"]) for report in reports]
    held = sum(int(report.get(HELD, report["n_frames"])) for report in reports)
    return {
        "method": method,
        START: TRUTH if starts_differ(reports) else "none",
        "assembly": assembly,
        "n_runs": len(reports),
        "n_frames": sum(frames),
        **({HELD: held} if held < sum(frames) else {}),
        "plain": _means(reports, [1] * len(reports)),
        "frame_weighted": _means(reports, frames),
    }


def _means(reports: Sequence[Mapping[str, Any]], weights: Sequence[int]) -> dict[str, Figures]:
    result: dict[str, Figures] = {}
    for section in SECTIONS:
        if any(section not in report for report in reports):
            continue
        keys = dict.fromkeys(key for report in reports for key in report[section])
        result[section] = {
            key: _weighted([report[section].get(key) for report in reports], weights)
            for key in keys
        }
    return result


def _weighted(values: Sequence[float | int | None], weights: Sequence[int]) -> float | None:
    known = [(v, w) for v, w in zip(values, weights, strict=True) if v is not None]
    total = sum(weight for _, weight in known)
    return sum(value * weight for value, weight in known) / total if total else None
