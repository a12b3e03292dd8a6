"""Whole reports: small runs whose figures can be worked out by hand, under both protocols."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asdfviz.data.result_csv import GIVEN_BEFORE
from asdfviz.datatypes import Assembly, Camera, FramePrediction, FrameTruth, Part, PoseEstimate, Run
from asdfviz.errors import RunError, SequenceError
from asdfviz.evaluate.bop import View
from asdfviz.evaluate.evaluate import evaluate_run, runtime_figures
from asdfviz.evaluate.paper_layout import escaped
from asdfviz.evaluate.pose_errors import add, error_model
from asdfviz.evaluate.protocols import MEAN_FIGURES, ProtocolName, gbot_evaluated_parts
from asdfviz.evaluate.summary import summaries
from asdfviz.evaluate.tables import markdown_table, means_table, runs_in
from asdfviz.evaluate.terminal_table import means_summary, runs_summary
from asdfviz.geometry.symmetry import Axis, Symmetries
from asdfviz.geometry.transforms import rotation_about, transform_from, turn_about

MakeTruth = Callable[..., FrameTruth]
MakePrediction = Callable[..., FramePrediction]
MakeRun = Callable[..., Run]


def placed(x: float = 0.0, y: float = 0.0, z: float = 0.5, *, turn: float = 0.0) -> np.ndarray:
    """A pose in front of the camera, turned by `turn` degrees about its z axis."""
    R = rotation_about(np.array([0.0, 0, 1]), np.deg2rad(turn))
    return transform_from(R, np.array([x, y, z]))


def all_figures(report: dict[str, Any]) -> list[float | None]:
    """Every figure of a report, from every section."""
    parts = [value for figures in report["parts"].values() for value in figures.values()]
    others = [report[section].values() for section in ("mean", "state", "runtime_ms")]
    return [*parts, *(value for values in others for value in values)]


def test_a_perfect_run(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    poses = {"plate": placed(), "rod": placed(0.05), "block": placed(-0.05, turn=40)}
    truth = {i: make_truth(i, poses, state=i // 2, is_error=False) for i in range(6)}
    run = make_run(
        [
            make_prediction(i, poses, state=i // 2, runtime={"detector": 0.02, "total": 0.03 + i})
            for i in range(6)
        ]
    )
    report = evaluate_run(run, assembly=assembly, truth=truth)
    assert list(report) == [
        *("method", "start", "sequence", "protocol", "n_frames", "parts", "mean", "state"),
        *("runtime_ms", "assembly", "state_details"),
    ]
    assert (report["method"], report["sequence"], report["protocol"]) == (
        "fake",
        "toy_scene",
        "strict",
    )
    assert report["n_frames"] == 6
    assert set(report["parts"]) == set(assembly.parts)
    means = {
        **dict.fromkeys(MEAN_FIGURES, 0),
        "add_s_10cm": 100,
        "add_s_01d": 100,
        "auc_add_s_10cm": 100,
        "auc_add_s_2cm": 100,
        "detection_recall": 100,
        "box_recall": 100,
        "box_precision": 100,
    }
    twins = {f"{key}_twins": value for key, value in means.items()}
    unsure = 10  # all are right, of each 0.9 is said
    scores = {"score_auc": None, "score_ece": unsure}
    exchanged = {f"{key}_twins": value for key, value in scores.items()}
    assert report["mean"] == pytest.approx(
        {**means, **twins, **scores, **exchanged, "ar_bop": None}, abs=1e-5
    )
    perfect = ("accuracy", "accuracy_tol2", "macro_f1", "macro_f1_state_part", "edit", "pos")
    assert {report["state"][key] for key in (*perfect, "f1_10", "f1_25", "f1_50")} == {100}
    zeros = (
        "delay_frames_median",
        "delay_frames_abs_median",
        "false_transitions",
        "step_delay_frames",
        "ece",
    )
    assert {report["state"][key] for key in zeros} == {0}
    assert report["state"]["error_recall"] is report["state"]["error_precision"] is None
    assert report["state_details"]["confusion"]["frames"] == [
        *([2, 0, 0, 0, 0], [0, 2, 0, 0, 0], [0, 0, 2, 0, 0], [0, 0, 0, 0, 0])
    ]
    assert report["runtime_ms"] == pytest.approx(
        {"detector": 20, "total_median": 2530, "total_mean": 2530, "total_p95": 4780}
    )


def test_strict_figures_by_hand(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    poses = {"plate": placed(), "rod": placed(0.05)}
    truth = {
        0: make_truth(0, poses),
        1: make_truth(1, poses, visible={"plate": 0.2, "rod": 0.05}),
        2: make_truth(2, poses),
        3: make_truth(3, poses),
    }
    run = make_run(
        [
            # 5 mm off, 4 degrees turned; the rod turned about its own axis.
            make_prediction(0, {"plate": placed(0.005, turn=4), "rod": placed(0.05, turn=70)}),
            # The rod cannot be seen: neither found nor missed. The plate is 2 m off, no cap.
            make_prediction(1, {"plate": placed(2.0), "rod": placed(0.3)}),
            # The plate is missed; the block is not there at all.
            make_prediction(2, {"rod": placed(0.05, 0.02), "block": placed()}),
            make_prediction(3, {"plate": placed(0.0, 0.03)}),
        ]
    )
    report = evaluate_run(run, assembly=assembly, truth=truth)
    plate, rod, block = (report["parts"][name] for name in ("plate", "rod", "block"))
    assert (plate["n_visible"], plate["n_poses"], plate["false_positives"]) == (4, 3, 0)
    assert plate["add_s_10cm"] == 50  # frames 0 and 3 of four
    assert plate["add_s_01d"] == 25  # d is 91.7 mm: frame 0 alone
    assert plate["e_t_mm"] == pytest.approx((5 + 2000 + 30) / 3)
    assert plate["e_t_mm_median"] == pytest.approx(30)
    # Linear between the second and the third of three values, at place 1.8 of 0 to 2.
    assert plate["e_t_mm_p90"] == pytest.approx(30 + 0.8 * 1970)
    plate_points = error_model(assembly.parts["plate"]).points
    turned = add(placed(0.005, turn=4), placed(), plate_points)
    assert plate["auc_add_s_10cm"] == pytest.approx((100 - 1000 * turned + 70 + 0 + 0) / 4)
    assert plate["auc_add_s_2cm"] == pytest.approx(5 * (20 - 1000 * turned) / 4)
    assert plate["e_r_deg"] == pytest.approx(4 / 3)
    assert plate["detection_recall"] == pytest.approx(100 * 2 / 3)  # frame 1 shows only 20 %
    # In place in frame 0 alone; given in 0, 1 and 3. The rod twice, the last 20 mm aside.
    assert plate["box_recall"] == plate["box_precision"] == pytest.approx(100 / 3)
    assert (rod["box_recall"], rod["box_precision"]) == pytest.approx((100 / 3, 50))
    assert block["box_precision"] == 0
    assert (rod["n_visible"], rod["n_poses"]) == (3, 2)
    assert rod["add_s_10cm"] == pytest.approx(200 / 3)
    assert rod["add_s_01d"] == pytest.approx(100 / 3)
    assert rod["e_t_mm"] == pytest.approx(10)
    assert rod["e_r_deg"] == pytest.approx(35)
    assert rod["e_r_sym_deg"] == pytest.approx(0, abs=1e-5)
    assert rod["detection_recall"] == pytest.approx(200 / 3)
    assert block["false_positives"] == 1
    assert {block[key] for key in MEAN_FIGURES if key != "box_precision"} == {None}
    assert report["mean"]["add_s_10cm"] == pytest.approx((50 + 200 / 3) / 2)
    assert report["mean"]["e_t_mm"] == pytest.approx((2035 / 3 + 10) / 2)
    assert report["mean"]["e_r_deg"] == pytest.approx((4 / 3 + 35) / 2)
    assert set(report["state"].values()) == {None}
    # Of the five poses that are seen, the three right ones and two wrong ones have one score.
    assert report["mean"]["score_auc"] == pytest.approx(50)


@pytest.mark.parametrize(("protocol", "e_t_mm"), [("strict", 0.0), ("gbot", 80.0)])
def test_only_gbots_rules_take_a_symmetric_turn_for_a_shift(
    assembly: Assembly,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
    protocol: ProtocolName,
    e_t_mm: float,
) -> None:
    """The rod's axis lies 40 mm beside its origin, which a half turn takes to the other side."""
    z, beside = np.array([0.0, 0, 1]), np.array([0.04, 0, 0])
    rod = assembly.parts["rod"]
    mesh = replace(rod.mesh, vertices=rod.mesh.vertices + beside)
    rod = replace(rod, mesh=mesh, symmetries=Symmetries(continuous=(Axis(z, beside),)))
    model = replace(assembly, parts={**assembly.parts, "rod": rod})
    run = make_run([make_prediction(0, {"rod": placed() @ turn_about(z, beside, np.pi)})])
    truth = {0: make_truth(0, {"rod": placed()})}
    report = evaluate_run(run, assembly=model, truth=truth, protocol=protocol)
    assert report["parts"]["rod"]["e_t_mm"] == pytest.approx(e_t_mm, abs=1e-6)


def test_gbot_figures_by_hand(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    poses = {"plate": placed(), "rod": placed(0.05), "block": placed(-0.1)}
    truth = {i: make_truth(i, poses, state=0, visible=0.01) for i in range(4)}
    run = make_run(
        [
            make_prediction(0, {"plate": placed(0.09), "rod": placed(0.05, turn=90)}, state=0),
            # 95 mm is beyond the diameter of 91.7 mm: infinite, though below 10 cm.
            make_prediction(1, {"plate": placed(0.095), "rod": placed(0.05, 0.06)}, state=1),
            # 1.2 m is left out of the mean of e_t.
            make_prediction(2, {"plate": placed(1.2, turn=30)}, state=0),
            make_prediction(3, {}, state=0),
        ]
    )
    report = evaluate_run(run, assembly=assembly, truth=truth, protocol="gbot")
    plate, rod, block = (report["parts"][name] for name in ("plate", "rod", "block"))
    assert plate["n_poses"] == 3
    assert plate["add_s_10cm"] == pytest.approx(100 / 3)
    assert plate["e_t_mm"] == pytest.approx(92.5)
    assert plate["e_r_deg"] == pytest.approx(10)
    assert rod["add_s_10cm"] == 50  # the second is 60 mm off, d = 51 mm
    assert rod["e_r_deg"] == pytest.approx(45)
    assert block["add_s_10cm"] is None
    # The block has no estimate and adds 0; the rod is symmetric and left out of e_r.
    assert report["mean"]["add_s_10cm"] == pytest.approx((100 / 3 + 50 + 0) / 3)
    assert report["mean"]["e_t_mm"] == pytest.approx((92.5 + 30) / 2)
    assert report["mean"]["e_r_deg"] == pytest.approx(10)
    assert report["state"]["micro_f1"] == pytest.approx(200 / 3)
    assert report["state"]["accuracy"] == 75


def test_rows_that_say_not_found_count_by_the_authors_rules_alone(
    assembly: Assembly,
    camera: Camera,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
) -> None:
    poses = {"plate": placed(0.03, z=0.4), "rod": placed(0, z=1.2)}
    truth = {i: make_truth(i, poses) for i in range(2)}
    zero = {"plate": placed(0, z=0, turn=30), "rod": placed(0, z=0), "block": placed(0, z=0)}
    silent = [make_prediction(0, poses), make_prediction(1, {})]
    run = make_run([silent[0], replace(silent[1], not_found=zero)])
    report = evaluate_run(run, assembly=assembly, truth=truth, protocol="gbot")
    plate, rod = report["parts"]["plate"], report["parts"]["rod"]
    assert (plate["add_s_10cm"], plate["n_poses"]) == (50, 1)
    assert plate["e_t_mm"] == pytest.approx(np.hypot(30, 400) / 2)
    assert plate["e_r_deg"] == pytest.approx(15)
    assert (rod["add_s_10cm"], rod["e_t_mm"]) == (50, 0)  # 1.2 m is left out of the mean of e_t
    assert plate["detection_recall"] == 50
    assert report["parts"]["block"]["false_positives"] == 0
    for told in ("strict", "bop"):
        with_rows, without = (
            evaluate_run(one, assembly=assembly, truth=truth, camera=camera, protocol=told)
            for one in (run, make_run(silent))
        )
        assert with_rows == without


def test_the_authors_parts_are_known(assembly: Assembly) -> None:
    assert gbot_evaluated_parts(assembly) == tuple(assembly.parts)
    part: Part = assembly.parts["plate"]
    caliper = ("Fix", "Gear_1", "Gear_2", "Move_Bottom", "Move_Top_Vernier", "Roller")
    parts = {f"Caliper_{name}": part for name in caliper}
    other = Assembly("c", "C", "Caliper_Fix", parts, assembly.states, frozenset(), (), "/c")
    assert gbot_evaluated_parts(other) == (
        *("Caliper_Fix", "Caliper_Move_Bottom", "Caliper_Move_Top_Vernier"),
    )


@pytest.mark.parametrize("protocol", ["strict", "gbot"])
@pytest.mark.parametrize("has_truth", [True, False])
def test_an_empty_run_has_no_nan(
    protocol: str, has_truth: bool, assembly: Assembly, make_truth: MakeTruth, make_run: MakeRun
) -> None:
    truth = {7: make_truth(7, {"plate": placed()}, state=0)} if has_truth else {}
    report = evaluate_run(make_run([]), assembly=assembly, truth=truth, protocol=protocol)  # pyright: ignore[reportArgumentType]
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert all(value is None or np.isfinite(value) for value in all_figures(report))
    assert report["mean"]["e_t_mm"] is None
    assert report["runtime_ms"] == dict.fromkeys(("total_median", "total_mean", "total_p95"))
    assert report["n_frames"] == int(has_truth)
    if has_truth:
        assert report["mean"]["add_s_10cm"] == report["state"]["accuracy"] == 0
        assert "frame 7" in report["warnings"][0]
    else:
        assert "warnings" not in report


def test_frames_of_only_one_side(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    poses = {"plate": placed()}
    truth = {i: make_truth(i, poses, state=0) for i in (2, 4)}
    run = make_run([make_prediction(i, poses, state=0) for i in (4, 6, 8)])
    report = evaluate_run(run, assembly=assembly, truth=truth)
    assert report["n_frames"] == 2
    assert report["mean"]["add_s_10cm"] == report["state"]["accuracy"] == 50
    assert report["parts"]["plate"]["false_positives"] == 0
    missed, unknown = report["warnings"]
    assert missed.startswith("1 of 2 frames with truth")
    assert "2 frames of the run have no truth" in unknown


def test_a_frame_that_was_given_does_not_count(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {i: make_truth(i, {"plate": placed()}, state=0) for i in range(3)}
    run = make_run(
        [make_prediction(i, {"plate": placed(0.01 * i)}) for i in range(3)],
        initial="first_frame_truth",
    )
    report = evaluate_run(run, assembly=assembly, truth=truth)
    assert report["n_frames"] == 2
    assert report["mean"]["e_t_mm"] == pytest.approx(15)


def test_a_pose_of_an_unchecked_part_is_not_wrong(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {i: make_truth(i, {"plate": placed()}) for i in range(2)}
    truth[0] = replace(truth[0], unchecked=("rod",))
    run = make_run([make_prediction(i, dict.fromkeys(assembly.parts, placed())) for i in range(2)])
    parts = evaluate_run(run, assembly=assembly, truth=truth)["parts"]
    found = {name: figures["false_positives"] for name, figures in parts.items()}
    assert found == {"plate": 0, "rod": 1, "block": 2}


def test_truth_of_states_alone_makes_no_false_positives(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {0: make_truth(0, {}, state=1)}
    run = make_run([make_prediction(0, {"plate": placed()}, state=1)])
    report = evaluate_run(run, assembly=assembly, truth=truth)
    assert report["parts"]["plate"]["false_positives"] == 0
    assert report["state"]["accuracy"] == 100


def test_objects_that_the_assembly_does_not_know_are_left_aside(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {0: make_truth(0, {"plate": placed(), "cup": placed()}, visible={"plate": 1.0})}
    report = evaluate_run(
        make_run([make_prediction(0, {"plate": placed()})]), assembly=assembly, truth=truth
    )
    assert report["mean"]["add_s_10cm"] == 100


def test_a_run_that_does_not_fit(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {0: make_truth(0, {"plate": placed()})}
    zero = FramePrediction(0, {"plate": PoseEstimate("plate", np.zeros((4, 4)), 1.0, "pnp")}, None)
    good = make_prediction(0, {"plate": placed()})
    cases = {
        "'cup' is not in toy": [make_prediction(0, {"cup": placed()})],
        "not a rigid transform": [zero],
        "comes twice": [good, good],
    }
    for message, predictions in cases.items():
        with pytest.raises(RunError, match=message):
            evaluate_run(make_run(predictions), assembly=assembly, truth=truth)


def test_missing_visibility_without_a_camera(
    assembly: Assembly, make_truth: MakeTruth, make_run: MakeRun
) -> None:
    truth = {3: make_truth(3, {"plate": placed()}, visible=None)}
    with pytest.raises(SequenceError, match=r"frame 3.*scene_gt_info"):
        evaluate_run(make_run([]), assembly=assembly, truth=truth)


def test_missing_visibility_is_rendered(
    assembly: Assembly,
    camera: Camera,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
) -> None:
    # The block stands behind the plate, the rod beside it.
    poses = {"plate": placed(z=0.3), "block": placed(z=0.5), "rod": placed(0.08, z=0.4)}
    truth = {0: make_truth(0, poses, visible=None)}
    run = make_run([make_prediction(0, {"plate": placed(z=0.3)})])
    report = evaluate_run(run, assembly=assembly, truth=truth, camera=camera)
    seen = {name: figures["n_visible"] for name, figures in report["parts"].items()}
    assert seen == {"plate": 1, "block": 0, "rod": 1}


@pytest.mark.parametrize("initial", ["none", "first_frame_truth"])
def test_gbots_f1_leaves_out_one_frame_whoever_was_given_it(
    assembly: Assembly,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
    initial: str,
) -> None:
    truth = {i: make_truth(i, {"plate": placed()}, state=0) for i in range(10)}
    said = [make_prediction(i, {"plate": placed()}, state=int(i == 1)) for i in range(10)]
    run = make_run(said, initial=initial)
    report = evaluate_run(run, assembly=assembly, truth=truth, protocol="gbot")
    assert report["state"]["micro_f1"] == pytest.approx(100 * 8 / 9)


def test_what_was_measured_in_front_hides_parts_without_shares(
    assembly: Assembly,
    camera: Camera,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
) -> None:
    """A hand over the left half of the picture of frame 1; in frame 2 the share is known."""
    poses = {"plate": placed(z=0.4), "rod": placed(0.08, z=0.4)}
    truth = {i: make_truth(i, poses, visible=None) for i in range(2)}
    truth[2] = make_truth(2, poses, visible={"plate": 1.0, "rod": 1.0})
    depth = np.zeros((camera.height, camera.width), np.float32)
    left = int(camera.K[0, 0] * 0.04 / 0.4 + camera.K[0, 2])
    depth[:, :left] = 0.2
    views = {i: View(camera, None if i == 0 else depth) for i in range(3)}
    run = make_run([make_prediction(i, {}) for i in range(3)])
    report = evaluate_run(run, assembly=assembly, truth=truth, views=views.__getitem__)
    assert {n: figures["n_visible"] for n, figures in report["parts"].items()} == {
        **dict.fromkeys(assembly.parts, 0),
        "plate": 2,
        "rod": 3,
    }


def test_a_csv_begins_after_the_frame_that_was_given(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {i: make_truth(i, {"plate": placed()}) for i in range(3)}
    run = make_run(
        [make_prediction(i, {"plate": placed(0.01 * i)}) for i in (1, 2)],
        config={GIVEN_BEFORE: True},
        initial="first_frame_truth",
    )
    report = evaluate_run(run, assembly=assembly, truth=truth)
    assert report["n_frames"] == report["parts"]["plate"]["n_poses"] == 2
    assert report["mean"]["e_t_mm"] == pytest.approx(15)


def test_the_given_frame_does_not_count_where_truth_begins_before_the_images(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {i: make_truth(i, {"plate": placed()}) for i in range(20)}
    said = [make_prediction(i, {"plate": placed(0.01 * (i > 10))}) for i in range(10, 20)]
    run = make_run(said, initial="first_frame_truth")
    report = evaluate_run(run, assembly=assembly, truth=truth)
    assert report["n_frames"] == report["parts"]["plate"]["n_poses"] == 9
    assert report["mean"]["e_t_mm"] == pytest.approx(10)


@pytest.mark.parametrize("protocol", ["strict", "gbot"])
def test_a_run_of_a_kind_without_states_has_no_figures_of_them(
    assembly: Assembly,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
    protocol: ProtocolName,
) -> None:
    truth = {i: make_truth(i, {"plate": placed()}, state=i // 2, is_error=False) for i in range(4)}
    silent = [make_prediction(i, {"plate": placed()}) for i in range(4)]

    def judged(run: Run) -> dict[str, Any]:
        return evaluate_run(run, assembly=assembly, truth=truth, protocol=protocol)

    poses_alone = judged(make_run(silent, says_states=False))
    assert set(poses_alone["state"].values()) == {None}
    assert poses_alone["state_details"]["transitions"] == []
    assert poses_alone["mean"]["add_s_01d"] == 100
    row = markdown_table([poses_alone]).splitlines()[-1]
    assert [cell.strip() for cell in row.strip("|").split("|")][-9:] == ["-"] * 9
    assert judged(make_run(silent))["state"]["accuracy"] == 0
    spoken = [*silent[:3], make_prediction(3, {}, state=1)]
    assert judged(make_run(spoken, says_states=False))["state"]["accuracy"] == 25
    means = summaries([poses_alone, judged(make_run(spoken))])[-1]
    assert means["plain"]["state"]["accuracy"] == 25


def test_means_over_runs(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    def judged(count: int, off: float, name: str, **fields: str) -> dict[str, Any]:
        truth = {i: make_truth(i, {"plate": placed()}, state=0) for i in range(count)}
        run = make_run([make_prediction(i, {"plate": placed(off)}) for i in range(count)], **fields)
        return {**evaluate_run(run, assembly=assembly, truth=truth), "assembly": name}

    first, second, third = judged(1, 0.01, "a"), judged(3, 0.05, "b"), judged(2, 0.03, "b")
    means = summaries([first, second, third, judged(4, 0.01, "a", method="other")])
    assert [(m["method"], m["assembly"], m["n_runs"], m["n_frames"]) for m in means] == [
        *(("fake", "a", 1, 1), ("fake", "b", 2, 5), ("fake", None, 3, 6), ("other", None, 1, 4))
    ]
    assert means[2]["plain"]["mean"]["e_t_mm"] == pytest.approx(30)
    assert means[2]["frame_weighted"]["mean"]["e_t_mm"] == pytest.approx((10 + 150 + 60) / 6)
    assert means[2]["plain"]["mean"]["ar_bop"] is None
    assert means[1]["frame_weighted"]["state"]["accuracy"] == 0
    lines = means_table(means).splitlines()
    assert len(lines) == 2 + 2 * 4
    assert "30.0" in lines[6]
    assert "36.7" in lines[7]


@pytest.mark.parametrize("width", [60, 80, 100, 300])
def test_a_summary_is_as_wide_as_the_terminal(
    width: int,
    assembly: Assembly,
    make_truth: MakeTruth,
    make_prediction: MakePrediction,
    make_run: MakeRun,
) -> None:
    poses = {"plate": placed()}
    truth = {i: make_truth(i, poses, state=0, is_error=False) for i in range(3)}
    method = "a_method_that_has_a_name_of_many_words_and_one_that_tells_it_v2"
    run = make_run([make_prediction(i, poses, state=0) for i in range(2)], method=method)
    report = evaluate_run(run, assembly=assembly, truth=truth)
    lines = runs_summary([report, {**report, "sequence": "s" * 60}], width=width).splitlines()
    assert max(map(len, lines)) <= width
    assert lines[2].split()[0].endswith("it_v2")
    assert lines[2].split()[2] == "2/3"
    assert "<0.1d%" in lines[1]
    assert ("frames" in lines[1]) == (width == 300)  # the state within two frames
    assert "ms" not in lines[1].split()  # nobody took the time
    means = means_summary(summaries([report]), width=width).splitlines()
    assert max(map(len, means)) <= width
    assert "by frames" in means[3]


def test_twenty_frames_of_ten_parts_of_three_kinds(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    kinds = tuple(assembly.parts.values())
    parts = {f"part{i}": kinds[i % 3] for i in range(10)}
    big = Assembly("big", "Big", "part0", parts, assembly.states, frozenset(), (), "/big")
    poses = {name: placed(0.02 * i, turn=20 * i) for i, name in enumerate(parts)}
    found = {name: placed(0.02 * i + 0.01, turn=20 * i + 9) for i, name in enumerate(parts)}
    truth = {i: make_truth(i, poses) for i in range(20)}
    run = make_run([make_prediction(i, found) for i in range(20)])
    report = evaluate_run(run, assembly=big, truth=truth)
    assert report["mean"]["e_t_mm"] == pytest.approx(10)


def test_tables(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {i: make_truth(i, {"plate": placed()}) for i in range(2)}
    run = make_run([make_prediction(0, {"plate": placed(0.0123)})], method="a|<b>{c}")
    report = evaluate_run(run, assembly=assembly, truth=truth)
    lines = markdown_table([report, report]).splitlines()
    assert len({line.count("|") for line in lines[:4]}) == 1
    assert lines[2] == lines[3]
    assert "12.3" in lines[2]
    broken = {**report, "method": "a\nb", "sequence": "c\n| d"}
    assert markdown_table([broken]).splitlines()[2].startswith("| a b")
    told = runs_summary([report, broken], width=120).splitlines()
    assert told[3].split()[:5] == ["a", "b", "c", "|", "d"]
    assert "&#124;&lt;b&gt;&#123;c&#125;" in lines[2]
    assert "nan" not in markdown_table([report]).lower()
    assert lines[-1].startswith("- a&#124;")


def test_what_was_given_the_first_frames_truth_says_so(
    assembly: Assembly, make_truth: MakeTruth, make_prediction: MakePrediction, make_run: MakeRun
) -> None:
    truth = {i: make_truth(i, {"plate": placed()}) for i in range(3)}
    said = [make_prediction(i, {"plate": placed()}) for i in range(3)]
    tracked, found = (
        evaluate_run(make_run(said, method=name, initial=initial), assembly=assembly, truth=truth)
        for name, initial in (("tracks", "first_frame_truth"), ("finds", "none"))
    )
    assert (tracked["start"], found["start"]) == ("truth", "none")
    means = summaries([tracked, found])
    assert [entry["start"] for entry in means] == ["truth", "none"]
    for table in (
        markdown_table([tracked, found]),
        runs_summary([tracked, found], width=100),
    ):
        lines = [line.replace("|", " ").split() for line in table.splitlines()]
        assert lines[0][:3] == ["Method", "Start", "Sequence"]
        assert [line[:2] for line in lines[2:4]] == [["tracks", "truth"], ["finds", "none"]]
        assert "were handed the true poses of the first frame" in " ".join(table.split())
        assert "not judged on it" in " ".join(table.split())
    rows = list(csv.DictReader(io.StringIO(runs_in("csv", [tracked, found]))))
    assert [row["Start"] for row in rows] == ["truth", "none"]
    assert "tracks & truth & " in runs_in("latex", [tracked])
    told = means_summary(means, width=100).splitlines()
    assert [line.split()[:2] for line in told[2:5:2]] == [["tracks", "truth"], ["finds", "none"]]
    assert "| Method | Start |" in means_table(means)
    assert all(
        "tart" not in table
        for table in (
            markdown_table([found]),
            runs_summary([found], width=100),
            means_table(means[1:]),
        )
    )


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("a_b-1", "a_b-1"),
        ("x\n| y", "x &#124; y"),
        ("`*[", "&#96;&#42;&#91;"),
        ("GBOT's", "GBOT's"),
    ],
)
def test_escaped(text: str, shown: str) -> None:
    assert escaped(text) == shown


def test_what_comes_after_the_detector_is_timed_apart() -> None:
    times = [{"detect": 0.02, "refine": 0.01, "total": 0.04}, {"refine": 0.03, "total": 0.03}]
    predictions = [FramePrediction(k, {}, None, (), runtime) for k, runtime in enumerate(times)]
    figures = runtime_figures(predictions)
    assert (figures["after_detect_median"], figures["after_detect_p95"]) == pytest.approx(
        (25, 29.5)
    )
    assert figures["total_p95"] == pytest.approx(39.5)
    assert "after_detect_median" not in runtime_figures(predictions[1:])
