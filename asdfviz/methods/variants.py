"""What the ablations compare: a title, a method, its config, and the paper's row of the same kind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

from asdfviz.datatypes import Assembly
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.asdf_seg import AsdfSegConfig
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.common_variants import (
    ANY_COLOR,
    BEST_BOX,
    BLIND,
    BY_CROPS,
    TRUSTING,
    UNNAMED,
    UNSOUGHT,
    UNTOLD,
    common,
)
from asdfviz.methods.contour_fits import BY_POINTS, ContourConfig
from asdfviz.methods.disowned import DisownedConfig
from asdfviz.methods.doubts import DoubtConfig
from asdfviz.methods.drawn_looks import DrawnConfig
from asdfviz.methods.first_confidence import FirstConfidenceConfig
from asdfviz.methods.first_pose import FirstPose, crop_weights_path
from asdfviz.methods.group_poses import GroupConfig
from asdfviz.methods.held_colors import HeldConfig
from asdfviz.methods.leaps import LeapsConfig
from asdfviz.methods.network import masks_path
from asdfviz.methods.on_table import NO_TABLE, OnTableConfig
from asdfviz.methods.part_poses import PAPER_ICP
from asdfviz.methods.place_support import SupportConfig
from asdfviz.methods.second_look import SecondLookConfig
from asdfviz.methods.state_looks import has_state_network
from asdfviz.methods.still_there import StillThereConfig
from asdfviz.methods.track_confidence import TrackConfidenceConfig
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.methods.turn_table import TurnTableConfig
from asdfviz.methods.yolov8pose import Yolov8PoseConfig
from asdfviz.pose.translation import TranslationConfig, Weighting
from asdfviz.state.group_fit import GroupFitConfig
from asdfviz.state.lately_loose import LatelyLooseConfig
from asdfviz.state.relative_pose import SCORED_BY_PROBABILITY, PlaceOdds, RelativePoseConfig
from asdfviz.track.presets import FINE_DEPTH, FOLLOWED_DEPTH, PROPOSED

ONE_LOOK = SecondLookConfig(enabled=False)
OWNED = DisownedConfig(enabled=False)
STILL = TurnConfig(enabled=False)
COLORLESS = DrawnConfig(outline=0.0)
FORGOTTEN = LatelyLooseConfig(enabled=False)
UNHIDDEN = GroupConfig(hidden=0.0)
"""Pieces of several methods, off."""


@dataclass(frozen=True, slots=True)
class Variant:
    """One row of an ablation."""

    title: str
    method: str
    """Name of the registered method that runs it."""
    config: Any
    """Of that method."""
    paper: str = ""
    """Key of the paper's row, empty without one."""


def first_poses(config: Any, assembly: Assembly) -> list[FirstPose]:
    """The kinds of first pose that a method can start from: crops only where their weights are."""
    if not hasattr(config, "first_pose"):
        return []
    found: list[FirstPose] = ["keypoints"]
    if getattr(config, "published", False):
        return found
    if crop_weights_path(config.crops, assembly).is_file():
        found.append("hypotheses")
    return found


def refinement_variants(assembly: Assembly) -> list[Variant]:
    """Table 2: nothing, the paper's ICP and the other direction, masks where their weights are, the
    shift, and the whole methods; first poses by colour alone, and what depth says in them instead."""
    base, masked = Yolov8PoseConfig(first_depth=False), AsdfSegConfig(first_depth=False)
    other = replace(PAPER_ICP, direction="scan_to_model")
    has_masks = masks_path(masked.masks, masked.detector, assembly).is_file()
    rows = [
        Variant("none", "yolov8pose", base, "none"),
        Variant("ICP, model to scan", "yolov8pose", replace(base, refinement="icp"), "icp"),
        Variant("ICP, scan to model", "yolov8pose", replace(base, refinement="icp", icp=other)),
        *([Variant("segmentation (+Seg)", "asdf_seg", masked, "segmentation")] * has_masks),
        Variant(
            "translation (3.1.1)",
            "yolov8pose",
            replace(base, refinement="translation"),
            "translation",
        ),
        Variant(
            "translation, one step",
            "yolov8pose",
            replace(
                base,
                refinement="translation",
                translation=replace(base.translation, coarse=False, steps=1),
            ),
        ),
        Variant("asdf", "asdf", AsdfConfig()),
        Variant("asdf_plus", "asdf_plus", AsdfPlusConfig()),
    ]
    measured = Yolov8PoseConfig(first_pose="hypotheses")
    more = [Variant("depth in first poses, hypotheses", "yolov8pose", measured)]
    has_crops = "hypotheses" in first_poses(measured, assembly)
    return [*_with_first_poses(rows, assembly), *more * has_crops]


def weighting_variants(assembly: Assembly) -> list[Variant]:
    """Every weight function W(d) of section 3.1.1: in the steps that are the default, and in one."""
    base = Yolov8PoseConfig(refinement="translation", first_depth=False)
    several = [
        Variant(kind, "yolov8pose", replace(base, translation=TranslationConfig(weights=kind)))
        for kind in get_args(Weighting)
    ]
    single = [
        replace(
            row,
            title=f"{row.title}, one step",
            config=replace(
                base, translation=replace(row.config.translation, coarse=False, steps=1)
            ),
        )
        for row in several
    ]
    return _with_first_poses([*several, *single], assembly)


def group_variants(assembly: Assembly) -> list[Variant]:
    """State helps pose, off and on, in both methods."""
    plus = AsdfPlusConfig()
    off = GroupConfig(enabled=False)
    rows = [
        Variant("asdf without group", "asdf", AsdfConfig(group=off)),
        Variant("asdf with group", "asdf", AsdfConfig()),
        Variant("asdf_plus without group", "asdf_plus", replace(plus, joined=off)),
        Variant("asdf_plus with group", "asdf_plus", plus),
    ]
    return _with_first_poses(rows, assembly)


def state_variants(assembly: Assembly) -> list[Variant]:
    """The hypothesis test over states, off and on, in both methods that have it."""
    off = GroupFitConfig(enabled=False)
    rows = [
        Variant("asdf_plus without group fit", "asdf_plus", AsdfPlusConfig(group_fit=off)),
        Variant("asdf_plus with group fit", "asdf_plus", AsdfPlusConfig()),
        Variant("asdf_track without group fit", "asdf_track", AsdfTrackConfig(group_fit=off)),
        Variant("asdf_track with group fit", "asdf_track", AsdfTrackConfig()),
    ]
    return _with_first_poses(rows, assembly)


def beyond_variants(assembly: Assembly) -> list[Variant]:
    """What the methods beyond the paper weigh besides, each piece off; they need crop weights."""
    if len(first_poses(AsdfPlusConfig(), assembly)) < 2:
        return []
    rows = [*_beyond_asdf(), *_beyond_asdf_plus(), *_beyond_asdf_track()]
    if has_state_network(AsdfConfig().crops, assembly):
        return rows
    return [row for row in rows if not row.title.endswith(BY_CROPS)]


def _beyond_asdf() -> list[Variant]:
    unjudged = AsdfConfig(first_confidence=FirstConfidenceConfig(enabled=False), least_score=0.1)
    fleeting = AsdfConfig(first_confidence=FirstConfidenceConfig(steady=0.0))
    certain = RelativePoseConfig(in_place=PlaceOdds(offset=50.0))
    return [
        Variant("asdf", "asdf", AsdfConfig()),
        Variant("asdf, no look at places", "asdf", AsdfConfig(place_looks=BLIND)),
        Variant("asdf, base where its pose says", "asdf", AsdfConfig(base_votes=UNTOLD)),
        Variant("asdf, what lay loose forgotten", "asdf", AsdfConfig(lately_loose=FORGOTTEN)),
        Variant("asdf, hidden parts not placed", "asdf", AsdfConfig(group=UNHIDDEN)),
        Variant("asdf, nothing known of the table", "asdf", AsdfConfig(on_table=NO_TABLE)),
        Variant("asdf, unsure poses given", "asdf", AsdfConfig(least_score=0.0)),
        Variant("asdf, scored by boxes and crops", "asdf", unjudged),
        Variant("asdf, scored by each frame alone", "asdf", fleeting),
        Variant("asdf, places never in doubt", "asdf", AsdfConfig(relative_pose=certain)),
        Variant("asdf, names by the detector alone", "asdf", AsdfConfig(names=UNNAMED)),
        Variant("asdf, no contests", "asdf", AsdfConfig(contests=BEST_BOX)),
        Variant("asdf, no strangers", "asdf", AsdfConfig(names=TRUSTING)),
        Variant("asdf, missing parts not looked for", "asdf", AsdfConfig(names=UNSOUGHT)),
        Variant("asdf, twins of any colour", "asdf", AsdfConfig(unlike_twins=ANY_COLOR)),
        Variant(f"asdf, {BY_CROPS}", "asdf", AsdfConfig(state_looks="crops")),
    ]


def _beyond_asdf_plus() -> list[Variant]:
    plus = AsdfPlusConfig()
    kept, turns = plus.hypotheses, plus.contours.turns
    unaware = replace(turns, table=TurnTableConfig(enabled=False))
    contours = {
        "turns without the table": ContourConfig(turns=unaware),
        "turns by single points": ContourConfig(turns=BY_POINTS),
        "turned as settled": ContourConfig(turns=replace(turns, table=TurnTableConfig(lies=0.0))),
        "found anew in any turn": ContourConfig(turns=replace(turns, was=0.0)),
        "contested poses as sure": ContourConfig(turns=replace(turns, contested=1.0, beaten=1.0)),
        "runners-up never tried": ContourConfig(unsure=0.0),
        "no contours": ContourConfig(enabled=False),
        "contours of single parts": ContourConfig(together=False),
        "what rests settled too": ContourConfig(every=1),
        "nothing turned": ContourConfig(turns=STILL),
    }
    changed = {
        "unsure poses given": replace(plus, least_score=0.0),
        "first poses know the table": replace(plus, on_table=OnTableConfig()),
        **common(plus),
        **{title: replace(plus, contours=config) for title, config in contours.items()},
        "one look": replace(plus, second_look=ONE_LOOK),
        "no registration": replace(plus, registration=replace(plus.registration, enabled=False)),
        "one pose kept a part": replace(plus, hypotheses=replace(kept, kept=1)),
        "parts arrive at once": replace(plus, smoothing=replace(plus.smoothing, arrival=False)),
        "parts near by not drawn": replace(plus, group_fit=replace(plus.group_fit, near=0.0)),
        "looks in every frame": replace(plus, looks_every=1),
        "depth alone over time": replace(plus, hypotheses=replace(kept, network=0.0)),
        "depth where it is blind": replace(plus, hypotheses=replace(kept, blind=0.0)),
        "what rests looked at too": replace(plus, hypotheses=replace(kept, looked_every=1)),
        "held parts believed": replace(plus, confidence=replace(plus.confidence, elsewhere=0.0)),
        "held parts as sure unseen": replace(plus, confidence=replace(plus.confidence, unseen=0.0)),
        "missed parts believed": replace(plus, confidence=replace(plus.confidence, missed=0.0)),
        "places as sure as poses": replace(
            plus,
            relative_pose=replace(plus.relative_pose, in_place=SCORED_BY_PROBABILITY),
            loose=replace(plus.loose, far_sure=plus.loose.sure),
        ),
        "hands as fast as ever": replace(plus, loose=replace(plus.loose, carried=0.0)),
        "like things anywhere": replace(plus, still_there=StillThereConfig(enabled=False)),
        "what lay there never the part": replace(plus, still_there=StillThereConfig(better=1.0)),
        "what lay loose forgotten": replace(plus, lately_loose=FORGOTTEN),
        "hidden parts not placed": replace(plus, joined=UNHIDDEN),
        "leaps believed": replace(plus, leaps=LeapsConfig(odds=1.0)),
    }
    return _rows("asdf_plus", plus, changed)


def _beyond_asdf_track() -> list[Variant]:
    track = AsdfTrackConfig()
    turned = replace(track.refind, rotation_weight=0.0, box_weight=0.0)
    never = float("inf")
    stays = replace(track.refind, support=SupportConfig(lead=never, lost_lead=never))
    faithful = replace(track.refind, held=HeldConfig(unlike=0.0))
    whole = replace(PROPOSED, depth=replace(FOLLOWED_DEPTH, edge_px=0.0))
    coarse = replace(PROPOSED, depth=replace(FOLLOWED_DEPTH, sigmas=FINE_DEPTH.sigmas))
    persistent = replace(track.turns, liked_most=never, lead_seen=TurnConfig.lead_seen)
    changed = {
        **common(track),
        "nothing turned": replace(track, turns=STILL),
        "turns by single points": replace(track, turns=BY_POINTS),
        "turns without colours": replace(track, turns=replace(track.turns, drawn=COLORLESS)),
        "turns as crops keep saying": replace(track, turns=persistent),
        "turned whatever crops say": replace(track, turns=replace(track.turns, disliked=0.0)),
        "found anew in any turn": replace(track, turns=replace(track.turns, was=0.0)),
        "one look": replace(track, second_look=ONE_LOOK),
        "rivals by picture alone": replace(track, refind=turned),
        "never disowned": replace(track, refind=replace(track.refind, disowned=OWNED)),
        "never begun anew": replace(track, refind=stays),
        "held parts keep their colours": replace(track, refind=faithful),
        "held parts nowhere else": replace(track, join=replace(track.join, elsewhere=False)),
        "hidden parts unsure": replace(track, refind=replace(track.refind, hidden=0.0)),
        "what lay unsure": replace(track, refind=replace(track.refind, hidden_lain=0.0)),
        "hidden parts soon lost": replace(track, refind=replace(track.refind, patience=1)),
        "never in doubt": replace(track, doubt=DoubtConfig(unfound=1.0, other=1.0)),
        "depth at outlines too": replace(track, tracker=whole),
        "depth less exact": replace(track, tracker=coarse),
        "joined parts as if in sight": replace(track, tracker=replace(PROPOSED, silhouettes=False)),
        "loose parts hide, too": replace(track, tracker=replace(PROPOSED, silhouettes_loose=True)),
        "scored as it fits": replace(track, confidence=TrackConfidenceConfig(enabled=False)),
        "hidden parts anywhere": replace(track, still_there=StillThereConfig(enabled=False)),
    }
    return _rows("asdf_track", track, changed)


def _rows(method: str, config: Any, changed: Mapping[str, Any]) -> list[Variant]:
    """The method as it is, and with each of the changes."""
    rows = [Variant(method, method, config)]
    return rows + [Variant(f"{method}, {title}", method, c) for title, c in changed.items()]


def _with_first_poses(rows: Sequence[Variant], assembly: Assembly) -> list[Variant]:
    """Every row for every kind of first pose."""
    return [
        replace(row, title=f"{row.title}, {kind}", config=replace(row.config, first_pose=kind))
        for kind in first_poses(rows[0].config, assembly)
        for row in rows
    ]
