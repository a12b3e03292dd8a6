"""What an export says of missing poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import FrameTruth
from asdfviz.export.gaps import lacking, told_gaps, told_label_gaps


def truth_of(*frames: str) -> dict[int, FrameTruth]:
    """Frames 5, 6, ... in which the parts of the letters have poses."""
    return {
        5 + place: FrameTruth(5 + place, dict.fromkeys(letters, np.eye(4)), None)
        for place, letters in enumerate(frames)
    }


@pytest.mark.parametrize(
    ("frames", "told"),
    [
        (("ab", "ab", "ab"), ""),
        (("ab", "a", "a"), "without a pose, so exported as not there: b in 2 of 3 frames"),
        (
            ("a", "ab"),
            "no pose, and so no truth, in 1 of 3 frames; "
            "without a pose, so exported as not there: b in 1 of 2 frames",
        ),
    ],
)
def test_parts_without_poses_are_named(frames: tuple[str, ...], told: str) -> None:
    assert told_gaps(truth_of(*frames), (5, 6, 7), ("a", "b")) == told


def test_a_frame_lacks_what_nobody_said_is_not_there() -> None:
    assert lacking(5, {"a"}, ("a", "b", "c"), gone={(5, "b"), (6, "c")}) == ["c"]


def test_unchecked_parts_are_not_exported_as_not_there() -> None:
    truth = truth_of("ab", "a", "a")
    truth[7] = replace(truth[7], unchecked=("b",))
    assert told_gaps(truth, (5, 6, 7), ("a", "b")) == (
        "without a pose, and not taken away, so exported as unchecked: b in 1 of 3 frames; "
        "without a pose, so exported as not there: b in 1 of 3 frames"
    )


@pytest.mark.parametrize(
    ("unchecked", "told"),
    [
        (
            False,
            "1 frame left out in which nobody said of b whether it is there (--unchecked: it is not); "
            "without a pose, so exported as not there: b in 1 of 2 frames",
        ),
        (True, "without a pose, so exported as not there: b in 2 of 3 frames"),
    ],
)
def test_labels_cannot_say_that_a_part_is_unchecked(*, unchecked: bool, told: str) -> None:
    truth = truth_of("ab", "a", "a")
    truth[7] = replace(truth[7], unchecked=("b",))
    assert told_label_gaps(truth, (5, 6, 7), ("a", "b"), unchecked=unchecked) == told
    assert told_label_gaps(truth_of("ab", "ab"), (5, 6), ("a", "b")) == ""


def test_what_is_said_not_to_be_there_is_not_missed() -> None:
    gone = {(6, "b"), (7, "b")}
    assert told_gaps(truth_of("ab", "a", "a"), (5, 6, 7), ("a", "b"), gone=gone) == ""
