"""What the ablations compare: a title, a method, its config, and the paper's row of the same kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, get_args

from asdfviz.datatypes import Assembly
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_plus import AsdfPlusConfig
from asdfviz.methods.asdf_seg import AsdfSegConfig
from asdfviz.methods.asdf_track import AsdfTrackConfig
from asdfviz.methods.contests import ContestsConfig
from asdfviz.methods.contour_fits import ContourConfig
from asdfviz.methods.first_pose import FirstPose, crop_weights_path
from asdfviz.methods.group_poses import GroupConfig
from asdfviz.methods.network import masks_path
from asdfviz.methods.on_table import NO_TABLE, OnTableConfig
from asdfviz.methods.part_poses import PAPER_ICP
from asdfviz.methods.place_looks import PlaceLooksConfig
from asdfviz.methods.place_support import SupportConfig
from asdfviz.methods.second_look import SecondLookConfig
from asdfviz.methods.still_there import StillThereConfig
from asdfviz.methods.strangers import StrangersConfig
from asdfviz.methods.thing_names import NamesConfig
from asdfviz.methods.turn_checks import TurnConfig, TurnTableConfig
from asdfviz.methods.yolov8pose import Yolov8PoseConfig
from asdfviz.pose.translation import TranslationConfig, Weighting
from asdfviz.state.group_fit import GroupFitConfig
from asdfviz.state.relative_pose import PlaceOdds, RelativePoseConfig


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
    if crop_weights_path(config.crops, assembly).is_file():
        found.append("hypotheses")
    return found


def refinement_variants(assembly: Assembly) -> list[Variant]:
    """Table 2: nothing, the paper's ICP and the other direction, masks where their weights are, the
    shift, and the whole methods."""
    base, masked = Yolov8PoseConfig(), AsdfSegConfig()
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
    return _with_first_poses(rows, assembly)


def weighting_variants(assembly: Assembly) -> list[Variant]:
    """Every weight function W(d) of section 3.1.1: in the steps that are the default, and in one."""
    base = Yolov8PoseConfig(refinement="translation")
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
    plus, track = AsdfPlusConfig(), AsdfTrackConfig()
    if len(first_poses(plus, assembly)) < 2:
        return []
    once = SecondLookConfig(enabled=False)
    deaf = replace(plus.hypotheses, network=0.0)
    turned = replace(track.refind, rotation_weight=0.0, box_weight=0.0)
    never = float("inf")
    stays = replace(track.refind, support=SupportConfig(lead=never, lost_lead=never))
    certain = RelativePoseConfig(in_place=PlaceOdds(offset=50.0))
    flat, single = ContourConfig(enabled=False), ContourConfig(together=False)
    trusting = NamesConfig(strangers=StrangersConfig(enabled=False))
    still = TurnConfig(enabled=False)
    unturned = ContourConfig(turns=still)
    known, unaware = OnTableConfig(), TurnTableConfig(enabled=False)
    afloat = ContourConfig(turns=TurnConfig(table=unaware))
    unnamed, blind = NamesConfig(enabled=False), PlaceLooksConfig(enabled=False)
    best_box, credulous = ContestsConfig(enabled=False), StillThereConfig(enabled=False)
    return [
        Variant("asdf", "asdf", AsdfConfig()),
        Variant("asdf, no look at places", "asdf", AsdfConfig(place_looks=blind)),
        Variant("asdf, nothing known of the table", "asdf", AsdfConfig(on_table=NO_TABLE)),
        Variant("asdf, unsure poses given", "asdf", AsdfConfig(least_score=0.0)),
        Variant("asdf, places never in doubt", "asdf", AsdfConfig(relative_pose=certain)),
        Variant("asdf, names by the detector alone", "asdf", AsdfConfig(names=unnamed)),
        Variant("asdf, no contests", "asdf", AsdfConfig(contests=best_box)),
        Variant("asdf, no strangers", "asdf", AsdfConfig(names=trusting)),
        Variant("asdf_plus", "asdf_plus", plus),
        Variant("asdf_plus, unsure poses given", "asdf_plus", replace(plus, least_score=0.0)),
        Variant(
            "asdf_plus, first poses know the table", "asdf_plus", replace(plus, on_table=known)
        ),
        Variant("asdf_plus, turns without the table", "asdf_plus", replace(plus, contours=afloat)),
        Variant(
            "asdf_plus, names by the detector alone", "asdf_plus", replace(plus, names=unnamed)
        ),
        Variant("asdf_plus, no look at places", "asdf_plus", replace(plus, place_looks=blind)),
        Variant("asdf_plus, no contests", "asdf_plus", replace(plus, contests=best_box)),
        Variant("asdf_plus, no strangers", "asdf_plus", replace(plus, names=trusting)),
        Variant("asdf_plus, no contours", "asdf_plus", replace(plus, contours=flat)),
        Variant("asdf_plus, contours of single parts", "asdf_plus", replace(plus, contours=single)),
        Variant("asdf_plus, nothing turned", "asdf_plus", replace(plus, contours=unturned)),
        Variant("asdf_plus, one look", "asdf_plus", replace(plus, second_look=once)),
        Variant("asdf_plus, depth alone over time", "asdf_plus", replace(plus, hypotheses=deaf)),
        Variant("asdf_track", "asdf_track", track),
        Variant(
            "asdf_track, names by the detector alone", "asdf_track", replace(track, names=unnamed)
        ),
        Variant("asdf_track, no look at places", "asdf_track", replace(track, place_looks=blind)),
        Variant("asdf_track, no contests", "asdf_track", replace(track, contests=best_box)),
        Variant("asdf_track, no strangers", "asdf_track", replace(track, names=trusting)),
        Variant("asdf_track, nothing turned", "asdf_track", replace(track, turns=still)),
        Variant("asdf_track, one look", "asdf_track", replace(track, second_look=once)),
        Variant("asdf_track, rivals by picture alone", "asdf_track", replace(track, refind=turned)),
        Variant("asdf_track, never begun anew", "asdf_track", replace(track, refind=stays)),
        Variant(
            "asdf_track, hidden parts anywhere", "asdf_track", replace(track, still_there=credulous)
        ),
    ]


def _with_first_poses(rows: Sequence[Variant], assembly: Assembly) -> list[Variant]:
    """Every row for every kind of first pose."""
    return [
        replace(row, title=f"{row.title}, {kind}", config=replace(row.config, first_pose=kind))
        for kind in first_poses(rows[0].config, assembly)
        for row in rows
    ]
