"""Identical parts: exchanged by the least total error, and matched as BOP does, by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Camera, FramePrediction, FrameTruth, PoseEstimate, Run
from asdfviz.evaluate.bop import passed
from asdfviz.evaluate.evaluate import evaluate_run
from asdfviz.evaluate.pose_errors import error_model
from asdfviz.evaluate.tables import markdown_table
from asdfviz.evaluate.twins import exchanged
from asdfviz.geometry.transforms import transform_from
from asdfviz.state.twins import twin_groups

MakeTruth = Callable[..., FrameTruth]
MakeRun = Callable[..., Run]


@pytest.fixture(scope="module")
def clamp(assembly: Assembly) -> Assembly:
    """The toy assembly with a second plate; the block has the plate's class but another mesh."""
    parts = dict(assembly.parts)
    parts["plate-Copy"] = replace(parts["plate"], name="plate-Copy")
    parts["block"] = replace(parts["block"], detector_class="plate")
    return replace(assembly, parts=parts)


def at(x_mm: float) -> np.ndarray:
    return transform_from(np.eye(3), np.array([1e-3 * x_mm, 0.0, 0.6]))


def said(index: int, **poses: tuple[float, float]) -> FramePrediction:
    """Parts by their place across, mm, and score; an underscore stands for the dash."""
    estimates = {
        (name := key.replace("_", "-")): PoseEstimate(name, at(x_mm), score, "pnp")
        for key, (x_mm, score) in poses.items()
    }
    return FramePrediction(index, estimates, None)


def test_twins_share_class_and_mesh(clamp: Assembly, assembly: Assembly) -> None:
    assert twin_groups(clamp) == (("plate", "plate-Copy"), ("rod",), ("block",))
    assert twin_groups(assembly) == (("plate",), ("rod",), ("block",))


def test_exchanged_figures_by_hand(
    clamp: Assembly, camera: Camera, make_truth: MakeTruth, make_run: MakeRun
) -> None:
    """Plates at 0 and 100 mm, turned alike: ADD is the distance. d is 91.7 mm, a tenth 9.2."""
    both = {"plate": at(0), "plate-Copy": at(100)}
    truth = {i: make_truth(i, both) for i in range(4)}
    run = make_run(
        [
            said(0, plate=(2, 0.9), plate_Copy=(96, 0.9)),  # as named: 2, 4
            said(1, plate=(101, 0.9), plate_Copy=(3, 0.9)),  # swapped: 3, 1 instead of 101, 97
            said(2, plate=(94, 0.9)),  # named plate, lies on the copy by 6; the other is missed
            # 30 + 70 as named; 0.1 m at most counts, so that 130 and 30 = 100 + 30 is worse.
            said(3, plate=(30, 0.2), plate_Copy=(-30, 0.2)),
        ]
    )
    report = evaluate_run(run, assembly=clamp, truth=truth, camera=camera)
    plate, copy = report["parts"]["plate"], report["parts"]["plate-Copy"]
    assert (plate["add_s_01d"], copy["add_s_01d"]) == (25.0, 25.0)
    assert plate["add_s_10cm"] == 75.0  # 2, 94, 30 of four; 101 is not
    assert (plate["add_s_01d_twins"], copy["add_s_01d_twins"]) == (50.0, 75.0)
    # Frame 3 ends as 30 to the plate's left (-30) and 70 short of the copy: 30 + 70 is the least.
    assert plate["e_t_mm_twins"] == pytest.approx((2 + 3 + 30) / 3)
    assert copy["e_t_mm_twins"] == pytest.approx((4 + 1 + 6 + 70) / 4)
    assert (plate["detection_recall_twins"], copy["detection_recall_twins"]) == (75.0, 100.0)
    assert report["mean"]["add_s_01d_twins"] == pytest.approx((50.0 + 75.0) / 2)
    # By name two are right and five wrong, three of these as sure; exchanged, only the unsure are.
    assert report["mean"]["score_auc"] == pytest.approx(100 * (3 * 0.5 + 2) / 5)
    assert report["mean"]["score_auc_twins"] == pytest.approx(100)
    # Two of five are right at 0.9, none of two at 0.2; exchanged, five and none.
    assert report["mean"]["score_ece"] == pytest.approx(100 * (5 * 0.5 + 2 * 0.2) / 7)
    assert report["mean"]["score_ece_twins"] == pytest.approx(100 * (5 * 0.1 + 2 * 0.2) / 7)
    table = markdown_table([report])
    assert "ADD(S) < 0.1 d, twins [%]" in table
    assert "62.5" in table
    gbot = evaluate_run(run, assembly=clamp, truth=truth, camera=camera, protocol="gbot")
    # Bounding spheres that do not overlap miss, what is absent does not count: 2 and 30 of four.
    assert gbot["parts"]["plate"]["add_s_10cm"] == 50.0
    assert gbot["parts"]["plate"]["add_s_10cm_twins"] == 100.0
    assert gbot["parts"]["plate-Copy"]["e_t_mm_twins"] == copy["e_t_mm_twins"]
    assert gbot["mean"]["e_t_mm_twins"] == pytest.approx((35 / 3 + 81 / 4) / 2)


def test_a_pose_by_a_twins_name_is_no_false_positive(
    clamp: Assembly, camera: Camera, make_truth: MakeTruth, make_run: MakeRun
) -> None:
    """Of the two plates only one is there, in frame 1 and 2 beside a pose of nothing."""
    truth = {i: make_truth(i, {"plate": at(0)}) for i in range(3)}
    run = make_run(
        [
            said(0, plate_Copy=(2, 0.9)),
            said(1, plate=(3, 0.9), plate_Copy=(150, 0.9)),
            said(2, plate=(150, 0.9), plate_Copy=(3, 0.9)),
        ]
    )
    report = evaluate_run(run, assembly=clamp, truth=truth, camera=camera)
    plate, copy = report["parts"]["plate"], report["parts"]["plate-Copy"]
    assert (plate["box_precision"], copy["box_precision"]) == (50.0, 0.0)
    assert copy["false_positives"] == 3
    assert (plate["add_s_01d_twins"], plate["box_recall_twins"]) == (100.0, 100.0)
    assert plate["box_precision_twins"] == 100.0
    assert copy["box_precision_twins"] == 0.0  # of two: what is left over in frames 1 and 2
    first = {0: truth[0]}
    alone = evaluate_run(make_run([said(0, plate_Copy=(2, 0.9))]), assembly=clamp, truth=first)
    assert alone["parts"]["plate-Copy"]["box_precision_twins"] is None
    assert alone["mean"]["box_precision_twins"] == 100.0


def test_poses_that_are_left_over_keep_their_names(assembly: Assembly) -> None:
    names = ("a", "b", "c")
    poses = {name: PoseEstimate(name, at(x), 0.9, "pnp") for name, x in (("b", 1), ("c", 200))}
    model = error_model(assembly.parts["plate"])
    assert exchanged(poses, {"b": at(0)}, names, model) == poses
    found = exchanged(poses, {"a": at(0)}, names, model)
    assert (found.keys(), found["a"], found["c"]) == ({"a", "c"}, poses["b"], poses["c"])
    # One beyond FAR is still the true one's, as long as there is no better.
    assert exchanged({"c": poses["c"]}, {"a": at(0)}, names, model) == {"a": poses["c"]}
    assert exchanged(poses, {}, names, model) == poses


def test_a_row_that_says_not_found_goes_to_the_twin_without_a_pose(
    clamp: Assembly, make_truth: MakeTruth, make_run: MakeRun
) -> None:
    truth = {0: make_truth(0, {"plate": at(0), "plate-Copy": at(100)})}
    zero = transform_from(np.eye(3), np.zeros(3))
    run = make_run([replace(said(0, plate=(98, 0.9)), not_found={"plate-Copy": zero})])
    gbot = evaluate_run(run, assembly=clamp, truth=truth, protocol="gbot")
    plate, copy = gbot["parts"]["plate"], gbot["parts"]["plate-Copy"]
    assert (plate["e_t_mm"], plate["e_t_mm_twins"]) == (pytest.approx(98), pytest.approx(600))
    assert copy["e_t_mm"] == pytest.approx(np.hypot(100, 600))
    assert copy["e_t_mm_twins"] == pytest.approx(2)
    assert (plate["add_s_10cm_twins"], copy["add_s_10cm_twins"]) == (0, 100)


def test_without_twins_the_figures_are_the_plain_ones(
    assembly: Assembly, camera: Camera, make_truth: MakeTruth, make_run: MakeRun
) -> None:
    truth = {0: make_truth(0, {"plate": at(0), "rod": at(100)})}
    run = make_run([said(0, plate=(100, 0.9), rod=(0, 0.9))])
    report = evaluate_run(run, assembly=assembly, truth=truth, camera=camera)
    for key in ("add_s_10cm", "e_t_mm_median", "e_r_sym_deg", "detection_recall"):
        assert report["mean"][f"{key}_twins"] == report["mean"][key]
    assert "twins" not in markdown_table([report])
    gbot = evaluate_run(run, assembly=assembly, truth=truth, camera=camera, protocol="gbot")
    assert gbot["mean"]["add_s_10cm_twins"] == gbot["mean"]["add_s_10cm"]
    assert gbot["mean"]["e_t_mm_twins"] == gbot["mean"]["e_t_mm"]


def test_the_greedy_matching_of_bop() -> None:
    """Rows are estimates, the surest first: each takes the nearest free target that is near enough."""
    errors = np.array([[4.0, 1.0], [2.0, 3.0]])
    found = passed(errors, np.array([1.0, 1.5, 2.5, 5.0]))
    assert found.tolist() == [[False, False, True, True], [False, True, True, True]]
    # The surer one takes the target that the other needs: no best assignment, but a greedy one.
    errors = np.array([[2.0, 2.5], [1.0, 9.0]])
    assert passed(errors, np.array([3.0])).tolist() == [[True], [False]]
    assert passed(np.array([[1.0, 2.0]]), np.array([3.0])).tolist() == [[True], [False]]


def test_bop_matches_twins_and_takes_the_surest(
    clamp: Assembly, camera: Camera, make_truth: MakeTruth, make_run: MakeRun
) -> None:
    both = {"plate": at(0), "plate-Copy": at(100)}
    hidden = {"plate": 1.0, "plate-Copy": 0.05}
    truth = {
        0: make_truth(0, both),
        1: make_truth(1, both, visible=hidden),
        2: make_truth(2, both, visible=hidden),
    }
    run = make_run(
        [
            said(0, plate=(100, 0.9), plate_Copy=(0, 0.8)),  # swapped, exact
            said(1, plate=(60, 0.3), plate_Copy=(0, 0.9)),  # one target: the surer one, exact
            said(2, plate=(0, 0.3), plate_Copy=(60, 0.9)),  # the surer one is wrong
        ]
    )
    report = evaluate_run(run, assembly=clamp, truth=truth, camera=camera, protocol="bop")
    # MSSD of 60 mm is 0.65 d: at no threshold. Three of the four targets pass at all of them.
    assert report["parts"]["plate"]["ar_mssd"] == pytest.approx(100 * 2 / 3)
    assert report["parts"]["plate-Copy"]["ar_mssd"] == pytest.approx(100.0)
    assert report["mean"]["ar_mssd"] == pytest.approx(75.0)
    assert report["mean"]["ar_vsd"] == pytest.approx(75.0)
