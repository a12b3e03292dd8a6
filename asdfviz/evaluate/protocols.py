"""What counts: the pose figures of a part, and of all parts, under the strict and the authors' rules.

`strict`: every part that can be seen counts, a missing pose is a miss. `bop`: the same, and the average
recalls of `asdfviz.evaluate.bop` beside it. `gbot`: the rules of the GBOT
authors' eval_calc_errors.py, by which the ASDF paper's tables were made. They count only the poses
that were handed in, rows of a csv that say "not found" among them, know no symmetry in e_t, and call a
share at 10 cm ADD(S); it is kept apart to compare with the paper.
Shares in percent, lengths in mm, angles in degrees; None where a figure is not defined.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal, TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, Part
from asdfviz.evaluate.pose_errors import PoseError
from asdfviz.evaluate.records import Comparison, PoseRecord

ProtocolName: TypeAlias = Literal["strict", "gbot", "bop"]
Figures: TypeAlias = dict[str, float | int | None]

VISIBLE = 0.1
"""A part counts from this visible share on, as in BOP's protocol of 2024."""
DETECTABLE = 0.3
"""Detection recall asks for parts from this visible share on."""
IN_PLACE = 0.5
"""Overlap of boxes (intersection over union) from which a pose is in the right place of the picture."""
ADD_LIMIT = 0.1
"""Metres: ADD(S)@10 cm."""
TIGHT_LIMIT = 0.02
"""Metres: AUC of ADD(S) to 2 cm, for small parts."""
DIAMETER_SHARE = 0.1
"""ADD(S) < 0.1 d."""
GBOT_MAX_E_T = 1.0
"""Metres: the authors leave larger translation errors out of their mean."""

TWINS = "_twins"
"""After a figure's name: with the poses of twins exchanged."""

_SHARES_OF_ADD = ("add_s_10cm", "add_s_01d", "auc_add_s_10cm", "auc_add_s_2cm")
_UNSYMMETRIC = ("e_r_deg", "e_r_deg_median", "e_r_deg_p90")
MEAN_FIGURES = (
    *_SHARES_OF_ADD,
    "e_t_mm",
    "e_t_mm_median",
    "e_t_mm_p90",
    *_UNSYMMETRIC,
    "e_r_sym_deg",
    "e_r_sym_deg_median",
    "e_r_sym_deg_p90",
    "detection_recall",
    "box_recall",
    "box_precision",
)

# obj4eval of the authors' script: the parts that each assembly's mean is taken over.
GBOT_EVALUATED_PARTS = (
    ("Corner_Clamp_Base", "Corner_Clamp_Bolt", "Corner_Clamp_Jaw"),
    ("Caliper_Fix", "Caliper_Move_Bottom", "Caliper_Move_Top_Vernier"),
    (
        "NanoViseV2_CLAMP_BALLJOINT",
        "NanoViseV2_CLAMP_BASE",
        "NanoViseV2_CLAMP_SCREW",
        "NanoViseV2_VISE_BASE",
        "NanoViseV2_VISE_SCREW",
        "NanoViseV2_VISE_SLIDER",
        "NanoViseV2_CLAMP_HEADPLATE",
        "NanoViseV2_CLAMP_NUT",
    ),
    ("HS_Jaw1", "HS_Jaw2", "HS_Knob1", "HS_Knob2", "HS_Pad", "HS_Thread1", "HS_Thread2"),
    (
        "Liftpod_armfirst",
        "Liftpod_armlast",
        "Liftpod_bar",
        "Liftpod_baseplate",
        "Liftpod_clampframe",
        "Liftpod_clampslider",
        "Liftpod_sleeve",
    ),
)


def pose_figures(
    comparison: Comparison, assembly: Assembly, protocol: ProtocolName
) -> tuple[dict[str, Figures], Figures]:
    """Return the figures of every part and their mean over parts; with twins exchanged too (TWINS)."""
    absent = comparison.false_positives
    parts, means = _figures_of(comparison.records, absent, assembly, protocol)
    exchanged, exchanged_means = _figures_of(
        comparison.exchanged, comparison.exchanged_false_positives, assembly, protocol
    )
    for name in assembly.parts:
        parts[name] |= {"false_positives": len(absent[name])}
        parts[name] |= {f"{key}{TWINS}": exchanged[name][key] for key in MEAN_FIGURES}
    return parts, means | {f"{key}{TWINS}": value for key, value in exchanged_means.items()}


def _figures_of(
    records: Iterable[PoseRecord],
    absent: Mapping[str, Sequence[int]],
    assembly: Assembly,
    protocol: ProtocolName,
) -> tuple[dict[str, Figures], Figures]:
    by_part = _by_part(records, assembly)
    part_figures = _gbot_figures if protocol == "gbot" else _strict_figures
    parts = {
        name: part_figures(by_part[name], part) | _detection(by_part[name], len(absent[name]))
        for name, part in assembly.parts.items()
    }
    if protocol == "gbot":
        return parts, _gbot_mean(parts, by_part, assembly)
    return parts, {key: mean(figures[key] for figures in parts.values()) for key in MEAN_FIGURES}


def twins_matter(means: Iterable[Mapping[str, object]], figures: Iterable[str]) -> bool:
    """Whether any of the figures of twins, by their names, differs from the plain one in any mean."""
    keys = tuple(figures)
    pairs = ((one, key) for one in means for key in keys if key in one)
    return any(one[key] != one.get(key.removesuffix(TWINS)) for one, key in pairs)


def _by_part(records: Iterable[PoseRecord], assembly: Assembly) -> dict[str, list[PoseRecord]]:
    by_part: dict[str, list[PoseRecord]] = {name: [] for name in assembly.parts}
    for record in records:
        by_part[record.part].append(record)
    return by_part


def gbot_evaluated_parts(assembly: Assembly) -> tuple[str, ...]:
    """Return the parts that the authors evaluate; all of them for an assembly they do not have."""
    for names in GBOT_EVALUATED_PARTS:
        if all(name in assembly.parts for name in names):
            return names
    return tuple(assembly.parts)


def mean(values: Iterable[float | int | None]) -> float | None:
    """Plain mean of the defined values."""
    defined = [value for value in values if value is not None]
    return float(np.mean(defined)) if defined else None


def percent(count: int, total: int) -> float | None:
    """Share in percent; None of nothing."""
    return 100.0 * count / total if total else None


def _strict_figures(records: Sequence[PoseRecord], part: Part) -> Figures:
    counted = [record for record in records if record.visible >= VISIBLE]
    errors = [record.error for record in counted if record.error is not None]
    adds = [error.add_s for error in errors]
    return {
        "n_visible": len(counted),
        "n_poses": len(errors),
        **_add_shares(adds, part, total=len(counted)),
        **_distances(errors, [error.e_t_sym for error in errors]),
    }


def _gbot_figures(records: Sequence[PoseRecord], part: Part) -> Figures:
    """By eval_calc_errors.py, which takes a row that says "not found" for a pose at the camera."""
    errors = [e for record in records if (e := record.error or record.not_found) is not None]
    # Bounding spheres that do not overlap make the authors' ADD(S) infinite.
    adds = [error.add_s if error.e_t < part.diameter else np.inf for error in errors]
    near = [error.e_t for error in errors if error.e_t < GBOT_MAX_E_T]
    return {
        "n_visible": sum(record.visible >= VISIBLE for record in records),
        "n_poses": sum(record.error is not None for record in records),
        **_add_shares(adds, part, total=len(errors)),
        **_distances(errors, near),
    }


def _gbot_mean(
    parts: Mapping[str, Figures], by_part: Mapping[str, Sequence[PoseRecord]], assembly: Assembly
) -> Figures:
    """Mean over the authors' parts; the rotation only over those without a symmetry.

    A part without any estimate adds 0 to ADD(S), as there. Their e_t and e_r then repeat the part
    before it, a slip of the script; here such a part is left out of both.
    """
    evaluated = [name for name in gbot_evaluated_parts(assembly) if by_part[name]]
    figures: Figures = {}
    for key in MEAN_FIGURES:
        names = evaluated
        if key in _UNSYMMETRIC:
            names = [n for n in names if not assembly.parts[n].symmetries.is_symmetric]
        values = [parts[name][key] for name in names]
        if key in _SHARES_OF_ADD:
            values = [0.0 if value is None else value for value in values]
        figures[key] = mean(values)
    return figures


def _add_shares(adds: Sequence[float], part: Part, *, total: int) -> Figures:
    return {
        "add_s_10cm": percent(sum(a < ADD_LIMIT for a in adds), total),
        "add_s_01d": percent(sum(a < DIAMETER_SHARE * part.diameter for a in adds), total),
        "auc_add_s_10cm": area_under_recall(adds, limit=ADD_LIMIT, total=total),
        "auc_add_s_2cm": area_under_recall(adds, limit=TIGHT_LIMIT, total=total),
    }


def area_under_recall(errors: Sequence[float], *, limit: float, total: int) -> float | None:
    """Area under the recall over thresholds from 0 to `limit`, percent of the whole.

    The exact integral of the step curve, mean(max(0, 1 - error / limit)); what is missing up to
    `total` counts 0. PoseCNN's script (Xiang et al., RSS 2018) adds up to one step a pose to it.
    """
    reached = sum(max(0.0, 1.0 - error / limit) for error in errors)
    return 100.0 * reached / total if total else None


def _distances(errors: Sequence[PoseError], e_t: Sequence[float]) -> Figures:
    e_t_mm = [1000.0 * value for value in e_t]
    e_r_deg = [float(np.rad2deg(error.e_r)) for error in errors]
    e_r_sym_deg = [float(np.rad2deg(error.e_r_sym)) for error in errors]
    return {
        **_spread("e_t_mm", e_t_mm),
        **_spread("e_r_deg", e_r_deg),
        **_spread("e_r_sym_deg", e_r_sym_deg),
    }


def _spread(name: str, values: Sequence[float]) -> Figures:
    """A figure's mean, median and 90th percentile: a few turned-over poses rule the mean."""
    return {
        name: mean(values),
        f"{name}_median": median(values),
        f"{name}_p90": percentile(values, 90.0),
    }


def median(values: Sequence[float] | np.ndarray) -> float | None:
    """Median, None of nothing."""
    return percentile(values, 50.0)


def percentile(values: Sequence[float] | np.ndarray, share: float) -> float | None:
    """The value that `share` percent lie under (between two values in proportion), None of nothing."""
    return float(np.percentile(values, share)) if len(values) else None


def _detection(records: Sequence[PoseRecord], absent: int) -> Figures:
    """Of the parts that can be seen well, how many have a pose, and one in the right place; of all poses,
    `absent` ones of parts that are not there among them, how many are in the right place."""
    asked = [record for record in records if record.visible >= DETECTABLE]
    given = [r for r in records if r.visible >= VISIBLE and r.error is not None]
    return {
        "detection_recall": percent(sum(r.error is not None for r in asked), len(asked)),
        "box_recall": percent(sum(map(_in_place, asked)), len(asked)),
        "box_precision": percent(sum(map(_in_place, given)), len(given) + absent),
    }


def _in_place(record: PoseRecord) -> bool:
    return record.error is not None and record.error.overlap >= IN_PLACE
