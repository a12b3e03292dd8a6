from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Detection
from asdfviz.methods.assignment import assign_detections


@pytest.mark.parametrize("order", [("short", "long"), ("long", "short")])
def test_of_different_parts_of_one_class_each_gets_the_box_that_fits(
    assembly: Assembly, box_at: Callable, order: tuple[str, str]
) -> None:
    pin = assembly.parts["pin"]
    bolts = {
        "short": replace(pin, name="short"),
        "long": replace(
            pin, name="long", mesh=replace(pin.mesh, vertices=3 * pin.mesh.vertices), diameter=0.2
        ),
    }
    assembly = replace(
        assembly, parts={"base": assembly.parts["base"], **{n: bolts[n] for n in order}}
    )
    left, right = box_at("pin", 10, score=0.8), box_at("pin", 200, score=0.6)

    for large, small in ((left, right), (right, left)):

        def fitting(box_xyxy: np.ndarray, large: Detection = large) -> set[str]:
            return {"long"} if box_xyxy is large.box_xyxy else {"short", "long"}

        assigned = assign_detections([left, right], assembly, fitting=fitting)
        assert assigned["long"] is large
        assert assigned["short"] is small
        # One box alone: the part that fills it, or that was there.
        assert set(assign_detections([large], assembly, fitting=fitting)) == {"long"}
        assert set(assign_detections([small], assembly, fitting=fitting)) == {"short"}
        where = {"long": small.box_xyxy, "short": large.box_xyxy}
        seen_on_end = assign_detections([small], assembly, previous=where, fitting=fitting)
        assert set(seen_on_end) == {"long"}


def test_nothing_detected_assigns_nothing(assembly: Assembly) -> None:
    assert assign_detections([], assembly) == {}


def test_the_best_box_of_a_class_wins(assembly: Assembly, box_at: Callable) -> None:
    boxes = [box_at("block", 0, score=0.4), box_at("block", 90, score=0.7), box_at("toy:block", 5)]
    assigned = assign_detections(boxes, assembly)
    assert set(assigned) == {"block"}
    assert assigned["block"].score == 0.7


def test_like_parts_are_named_from_left_to_right_at_first(
    assembly: Assembly, box_at: Callable
) -> None:
    boxes = [box_at("pin", 200, score=0.9), box_at("pin", 30, score=0.5)]
    for given in (boxes, boxes[::-1]):
        assigned = assign_detections(given, assembly)
        assert assigned["pin"].box_xyxy[0] == 30
        assert assigned["pin-copy"].box_xyxy[0] == 200


def test_like_parts_keep_their_names_when_they_cross(assembly: Assembly, box_at: Callable) -> None:
    previous = {
        "pin": np.array([200.0, 0, 220, 20]),
        "pin-copy": np.array([30.0, 0, 50, 20]),
    }
    boxes = [box_at("pin", 35, score=0.5), box_at("pin", 190, score=0.9)]
    assigned = assign_detections(boxes, assembly, previous=previous)
    assert assigned["pin"].box_xyxy[0] == 190
    assert assigned["pin-copy"].box_xyxy[0] == 35


def test_one_of_two_like_parts_goes_to_the_nearer_name(
    assembly: Assembly, box_at: Callable
) -> None:
    previous = {
        "pin": np.array([200.0, 0, 220, 20]),
        "pin-copy": np.array([30.0, 0, 50, 20]),
    }
    assigned = assign_detections([box_at("pin", 45)], assembly, previous=previous)
    assert set(assigned) == {"pin-copy"}


def test_a_part_seen_for_the_first_time_gets_the_free_name(
    assembly: Assembly, box_at: Callable
) -> None:
    previous = {"pin-copy": np.array([30.0, 0, 50, 20])}
    boxes = [box_at("pin", 35), box_at("pin", 5)]
    assigned = assign_detections(boxes, assembly, previous=previous)
    assert assigned["pin-copy"].box_xyxy[0] == 35
    assert assigned["pin"].box_xyxy[0] == 5


def test_two_boxes_on_one_object_are_one(assembly: Assembly, box_at: Callable) -> None:
    boxes = [
        box_at("pin", 30, score=0.9),
        box_at("pin", 33, score=0.8),
        box_at("pin", 90, score=0.3),
    ]
    assigned = assign_detections(boxes, assembly)
    assert assigned["pin"].box_xyxy[0] == 30
    assert assigned["pin-copy"].box_xyxy[0] == 90


def test_a_surer_box_of_another_part_rules_a_box_out(assembly: Assembly, box_at: Callable) -> None:
    wrong, right = box_at("block", 51, score=0.3), box_at("block", 150, score=0.2)
    base = box_at("base", 50, score=0.8)
    assigned = assign_detections([wrong, right, base], assembly)
    assert assigned["block"] is right
    # Nor by a box that is hardly surer; but by none beside it, nor by a state's box.
    hardly = box_at("base", 50, score=0.4)
    assert assign_detections([wrong, right, hardly], assembly)["block"] is right
    for other in (box_at("base", 60, score=0.8), box_at("toy:block", 50, score=0.8)):
        assert assign_detections([wrong, right, other], assembly)["block"] is wrong


def test_a_box_over_another_part_s_is_a_part_of_its_own_where_it_scores_enough(
    assembly: Assembly, box_at: Callable
) -> None:
    both = {"block": 0.5, "base": 0.8}  # what is in the place, as the detector tells it
    base = replace(box_at("base", 50, score=0.8), class_scores=both)
    block = replace(box_at("block", 54, score=0.5), class_scores=both)
    for given in ([base, block], [block, base]):
        assigned = assign_detections(given, assembly)
        assert assigned["base"].box_xyxy[0] == 50
        assert assigned["block"].box_xyxy[0] == 54
    for other in (replace(block, score=0.3), replace(block, box_xyxy=base.box_xyxy)):
        assert set(assign_detections([base, other], assembly)) == {"base"}


def test_a_thing_goes_to_the_next_likely_class_where_the_likeliest_lies_elsewhere(
    assembly: Assembly, box_at: Callable
) -> None:
    block = box_at("block", 0, score=0.9)
    pin = replace(box_at("block", 90, score=0.3), class_scores={"pin": 0.1, "base": 0.05})
    assigned = assign_detections([block, pin], assembly)
    assert assigned["block"] is block
    assert (assigned["pin"].label, assigned["pin"].score) == ("pin", 0.1)
    assert assigned["pin"].box_xyxy[0] == 90
    assert "base" not in assigned, "one thing is one part"


def test_a_class_that_is_hardly_like_a_thing_does_not_get_it(
    assembly: Assembly, box_at: Callable
) -> None:
    block, other = box_at("block", 0, score=0.9), box_at("block", 90, score=0.3)
    assigned = assign_detections([block, replace(other, class_scores={"pin": 0.02})], assembly)
    assert set(assigned) == {"block"}


def test_a_part_does_not_get_a_box_that_is_too_large_for_it(
    assembly: Assembly, box_at: Callable
) -> None:
    large = replace(box_at("pin", 0, score=0.5), class_scores={"base": 0.2})
    small = box_at("pin", 90, score=0.2)
    at = {"pin": large.box_xyxy}

    def fitting(box_xyxy: np.ndarray) -> set[str]:
        return {"base", "block"} if box_xyxy is large.box_xyxy else {"base", "block", "pin"}

    assigned = assign_detections([large, small], assembly, previous=at, fitting=fitting)
    assert assigned["base"].box_xyxy[0] == 0
    assert assigned["pin"] is small
    assert "pin-copy" not in assigned
    both = assign_detections([large, small], assembly)
    assert {name for name in both if name.startswith("pin")} == {"pin", "pin-copy"}
