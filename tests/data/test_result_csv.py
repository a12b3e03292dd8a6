from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asdfviz.data.result_csv import GIVEN_BEFORE, read_result_csv
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Assembly, Run
from asdfviz.errors import RunError

WriteScene = Callable[..., Any]
Read = Callable[..., Run]

EYE = "1 0 0 0 1 0 0 0 1"
TURNED = "0 -1 0 1 0 0 0 0 1"
HEADER = "scene_id,im_id,obj_id,score,R,t,time"


@pytest.fixture
def read(write_scene: WriteScene, tiny: Assembly, tmp_path: Path) -> Read:
    sequence = open_sequence(write_scene("gbot").folder, assembly=tiny)

    def read_text(text: str, **options: str) -> Run:
        file = tmp_path / "GBOTnormal.csv"
        file.write_text(text, encoding="utf-8")
        return read_result_csv(file, sequence=sequence, assembly=tiny, **options)

    return read_text


def test_the_gbot_evaluators_csv_reads_as_a_run(read: Read) -> None:
    run = read(
        f"normal,000004,base,-1,{TURNED},10.5 -20 500,12.5\n"
        f"normal,000004,jaw,-1,{EYE},0 0 0,12.5\n"
        f"normal,000004,mug,-1,{EYE},1 2 3,12.5\n"
    )
    assert (run.method, run.initial) == ("GBOTnormal", "first_frame_truth")
    assert run.config[GIVEN_BEFORE]
    assert run.config["rows_of_unknown_objects"] == 1
    assert run.config["unknown_objects"] == ["mug"]
    assert [p.frame_index for p in run.predictions] == [4, 7]
    first = run.predictions[0]
    # A zero translation says that the part was not found.
    assert list(first.poses) == ["base"]
    assert list(first.not_found) == ["jaw"]
    np.testing.assert_array_equal(first.not_found["jaw"], np.eye(4))
    expected = [[0, -1, 0, 0.0105], [1, 0, 0, -0.02], [0, 0, 1, 0.5], [0, 0, 0, 1]]
    np.testing.assert_allclose(first.poses["base"].T_camera_part, expected, atol=1e-12)
    assert first.poses["base"].score == 1.0
    assert first.poses["base"].stage == "csv"  # it does not say how they came about
    assert first.runtime == {"total": pytest.approx(0.0125)}
    assert dict(run.predictions[1].poses) == {}


def test_the_bop_csv_takes_numbers_seconds_and_the_best_score(read: Read) -> None:
    run = read(
        f"{HEADER}\n"
        f"1,3,2,0.2,{EYE},1 0 500,0.25\n1,3,2,0.9,{EYE},2 0 500,0.25\n1,3,2,0.5,{EYE},3 0 500,0.25\n"
        f"1,7,1,0.5,{EYE},0 0 500,-1\n",
        method="theirs",
    )
    assert (run.method, run.initial) == ("theirs", "none")
    assert not run.config[GIVEN_BEFORE]
    assert [p.frame_index for p in run.predictions] == [3, 4, 7]
    pose = run.predictions[0].poses["jaw"]
    assert (pose.T_camera_part[0, 3], pose.score) == (pytest.approx(0.002), 0.9)
    assert run.predictions[0].runtime == {"total": 0.25}
    assert dict(run.predictions[2].runtime) == {}


def test_a_scene_is_picked_from_many(read: Read) -> None:
    rows = f"a,3,base,-1,{EYE},0 0 400,1\nb,3,base,-1,{EYE},0 0 700,1\n"
    pose = read(rows, scene="b").predictions[0].poses["base"]
    assert pose.T_camera_part[2, 3] == pytest.approx(0.7)
    with pytest.raises(RunError, match="say which scene is meant; scenes: a, b"):
        read(rows)
    with pytest.raises(RunError, match="no scene 'c'; scenes: a, b"):
        read(rows, scene="c")
    own = f"{rows}scene,3,base,-1,{EYE},0 0 900,1\n"  # the sequence's folder is called so
    assert read(own).predictions[0].poses["base"].T_camera_part[2, 3] == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"is empty"),
        (f"{HEADER}\n", r"normal\.csv has a header, but no rows with results"),
        ("a,3,base\n", r"line 1: 3 columns, expected scene_id, im_id, .*, time$"),
        (f"{HEADER}\n1;3;2;0.5;{EYE};0 0 1;1\n", r"line 2: 1 column, .* between semicolons: put "),
        (f"1;3;2;0,5;{EYE};0 0 1,5;0,1\n", r"line 1: 4 columns, .* between semicolons: .* points"),
        (HEADER.replace(",", "\t"), r"line 1: 1 column, .* between tabs: put commas there"),
        (f"a,x,base,-1,{EYE},0 0 1,1\n", r"line 1: the frame is 'x'"),
        (f"a,{'9' * 5000},base,-1,{EYE},0 0 1,1\n", r"line 1: the frame is '9{40}', expected a"),
        (f"a,3,base,-1,{EYE},0 0 1e300,1\n", r"line 1: t is '0 0 1e300', expected millimetres"),
        ("a,3,base,-1,1 2,0 0 1,1\n", r"line 1: R is '1 2', expected 9"),
        (f"a,3,base,-1,{EYE},0 0 1,1\na,4,base,-1", r"line 2: 4 columns"),
        (f"a,3,base,-1,{EYE},0 0 nan,1\n", r"line 1: t is '0 0 nan', expected 3 finite"),
        (f"a,3,base,-1,{EYE},zero 0 1,1\n", r"line 1: t is 'zero 0 1', expected 3 numbers"),
        ("a,3,base,-1,2 0 0 0 2 0 0 0 2,0 0 1,1\n", r"line 1: R is no rotation \(determinant 8"),
        (
            f"{HEADER.replace('time', 'runtime')}\n1,3,base,0.5,{EYE},0 0 1,1\n",
            r"line 1 is a header, but names runtime; the one that is known is scene_id,im_id,",
        ),
        (
            f"im_id,scene_id{HEADER[14:]}\n3,1,2,-1,{EYE},0 0 1,1\n",
            r"but has another order; the one",
        ),
        (
            f"1,3,2,-1,{EYE},0 0 1,1\n",
            r"no header but all objects by number, .* put scene_id,im_id,",
        ),
        (
            f"a,3,base,-1,{EYE},0 0 1,1\na,4,jaw,0.5,{EYE},0 0 1,1\n",
            r"no header but the score 0\.5, and GBOT's",
        ),
        (f"a,3,nut,-1,{EYE},0 0 1,1\n", r"no pose of a known part: its objects are nut; .* has "),
        (f"a,5,base,-1,{EYE},0 0 1,1\n", r"frame 5, which scene does not have"),
    ],
)
def test_a_broken_csv_is_refused_with_its_line(read: Read, text: str, message: str) -> None:
    with pytest.raises(RunError, match=message):
        read(text)


def test_scores_of_any_range_keep_their_order(read: Read) -> None:
    run = read(
        f"{HEADER}\n1,3,2,3,{EYE},1 0 500,1\n1,3,2,8,{EYE},2 0 500,1\n1,4,2,-2,{EYE},3 0 500,1\n"
    )
    best, worst = (run.predictions[k].poses["jaw"] for k in (0, 1))
    assert best.T_camera_part[0, 3] == pytest.approx(0.002)
    assert (best.score, worst.score) == (1.0, 0.0)


def test_a_start_is_told_by_all_rows_and_only_trackers_have_one(read: Read) -> None:
    missed = f"a,3,base,-1,{EYE},0 0 0,1\na,4,base,-1,{EYE},0 0 500,1\n"
    assert read(missed).initial == "none"
    assert [p.frame_index for p in read(missed).predictions] == [3, 4, 7]
    # A BOP file with a mark of its encoding, as a spreadsheet writes it.
    run = read(f"\ufeff{HEADER.upper()}\n1,4,2,0.5,{EYE},0 0 500,1\n")
    assert run.initial == "none"
    assert [len(p.poses) for p in run.predictions] == [0, 1, 0]
    assert run.predictions[1].runtime == {"total": 1.0}


def test_a_csv_without_a_header_says_what_it_was_taken_for(read: Read) -> None:
    rows = f"a,4,base,-1,{EYE},0 0 500,1\na,7,base,-1,{EYE},0 0 500,1\n"
    told = "GBOTnormal.csv has no header and was read as GBOT's: times in ms, frames"
    started = f"{told} 4 to 7; the 1 before count as its start and are not judged"
    assert read(rows).config["csv_notes"] == [started]
    whole = f"a,3,jaw,-1,{EYE},0 0 500,1\n{rows}"
    assert read(whole).config["csv_notes"] == [f"{told} 3 to 7"]
    with_header = "".join(f"1,{i},2,0.5,{EYE},0 0 500,1\n" for i in (3, 4, 7))
    assert "csv_notes" not in read(f"{HEADER}\n{with_header}").config


def test_rows_that_repeat_a_part_are_counted(read: Read) -> None:
    row, *others = (f"1,{i},2,0.5,{EYE},1 0 500,1\n" for i in (3, 4, 7))
    rows = f"{HEADER}\n{row}{''.join(others)}"
    twice = f"{rows}1,3,2,0.9,{EYE},2 0 500,1\n{row}"
    (note,) = read(twice).config["csv_notes"]  # pyright: ignore[reportGeneralTypeIssues]
    assert note.startswith("2 rows too many: a part has several in a frame")
    assert "csv_notes" not in read(f"{rows}1,3,2,0.9,{EYE},0 0 0,1\n").config


def test_a_csv_of_few_frames_says_how_many(read: Read) -> None:
    config = read(f"{HEADER}\n1,3,2,0.5,{EYE},0 0 500,1\n1,7,2,0.5,{EYE},0 0 0,1\n").config
    assert config["csv_notes"] == ["only 2 of 3 frames have rows; the others have no pose"]
    assert config["frames_with_rows"] == 2


def test_a_number_that_copies_share_stands_for_all_of_them(read: Read) -> None:
    rows = f"1,3,5,0.3,{EYE},1 0 500,1\n1,3,5,0.9,{EYE},2 0 500,1\n1,3,5,0.5,{EYE},3 0 500,1\n"
    run = read(f"{HEADER}\n{rows}")
    poses = run.predictions[0].poses
    assert {name: pose.score for name, pose in poses.items()} == {"pin": 0.9, "pin-Copy": 0.5}
    assert poses["pin-Copy"].T_camera_part[0, 3] == pytest.approx(0.003)
    notes = run.config["csv_notes"]
    assert isinstance(notes, list)
    assert notes[-1].startswith("1 row too many: ")
    # A row that names a copy leaves the number the others.
    named = read(f"{HEADER}\n{rows}1,3,pin,0.1,{EYE},9 0 500,1\n").predictions[0].poses
    assert {name: pose.score for name, pose in named.items()} == {"pin": 0.1, "pin-Copy": 0.9}


def test_copies_without_names_go_on_under_the_name_of_the_nearest(read: Read) -> None:
    left, right, new = "0 0 500", "200 0 500", "-300 0 500"
    run = read(
        f"{HEADER}\n1,3,5,0.9,{EYE},{left},1\n1,3,5,0.5,{EYE},{right},1\n"
        f"1,4,5,0.4,{EYE},{left},1\n1,4,5,0.8,{EYE},{right},1\n1,7,5,0.8,{EYE},{right},1\n"
    )
    x = [{n: p.T_camera_part[0, 3] for n, p in said.poses.items()} for said in run.predictions]
    assert x == [
        {"pin": 0, "pin-Copy": pytest.approx(0.2)},
        {"pin": 0, "pin-Copy": pytest.approx(0.2)},
        {"pin-Copy": pytest.approx(0.2)},
    ]
    # What is far from the one that was seen is the other, though it has the best score.
    rows = f"1,3,5,0.9,{EYE},{left},1\n1,4,5,0.9,{EYE},{new},1\n"
    assert list(read(f"{HEADER}\n{rows}").predictions[1].poses) == ["pin-Copy"]


def test_a_row_that_says_not_found_is_kept_where_no_pose_is(read: Read) -> None:
    turned = f"a,3,pin,-1,{TURNED},0 0 0,1\n"
    zero = "a,3,jaw,-1,0 0 0 0 0 0 0 0 0,0 0 0,1\n"
    first = read(
        f"{turned}{zero}a,3,base,-1,{EYE},0 0 0,1\na,3,base,-1,{EYE},0 0 500,1\n"
    ).predictions[0]
    assert (list(first.poses), sorted(first.not_found)) == (["base"], ["jaw", "pin"])
    assert first.not_found["pin"][0].tolist() == [0, -1, 0, 0]
    np.testing.assert_array_equal(first.not_found["jaw"], np.eye(4))
    # Of a number that copies share it is about those that have no pose.
    shared = (
        f"{HEADER}\n1,3,5,0.9,{EYE},0 0 0,1\n1,3,5,0.5,{EYE},1 0 500,1\n1,3,5,0.4,{EYE},0 0 0,1\n"
    )
    first = read(shared).predictions[0]
    assert (list(first.poses), list(first.not_found)) == (["pin"], ["pin-Copy"])
