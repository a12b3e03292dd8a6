"""When states change, all frames known."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Assembly
from asdfviz.state.decoding import most_likely_path
from asdfviz.state.half_done import HalfDone


@pytest.fixture
def clamp() -> Assembly:
    """Base; jaw; jaw and bolt; an error."""
    return load_assembly("corner_clamp")


def test_what_a_hand_hides_is_done_towards_its_end(clamp: Assembly) -> None:
    """Nothing tells whether the jaw is in, a hint in one frame does not either."""
    early, hidden, done = (np.full(4, 0.02) for _ in range(3))
    early[0] = done[1] = 0.9
    hidden[[0, 1]] = 0.48, 0.5
    seen = [early] * 10 + [hidden] * 9 + [done] * 10
    path = most_likely_path(seen, seen, clamp)
    assert path is not None
    assert path == sorted(path)
    # It arrives in one of ten frames, and is in from the next: four in five of them are over by then.
    assert abs(path.index(1) - 18) <= 1


def test_a_state_is_told_for_a_frame_at_least(clamp: Assembly) -> None:
    seen = [np.eye(4)[state] + 0.01 for state in [0] * 5 + [1] * 2 + [2] * 5]
    assert most_likely_path(seen, seen, clamp) == [0] * 6 + [1] * 2 + [2] * 4
    assert most_likely_path(seen[6:7], seen[6:7], clamp) == [1]


def test_states_are_told_as_what_they_count_to() -> None:
    ways = HalfDone.of(load_assembly("geared_caliper"))
    half, count = min(ways.indices), len(ways.before)
    seen = [np.eye(count)[state] + 0.01 for state in [1] * 5 + [half] * 5 + [2] * 5]
    told = most_likely_path(
        seen, seen, ways.assembly, half_done=ways.indices, counts_to=ways.before
    )
    assert told == [1] * 11 + [2] * 4


def test_nothing_seen_at_all_is_no_path_and_between_frames_changes_nothing(clamp: Assembly) -> None:
    assert most_likely_path([None] * 3, [None] * 3, clamp) is None
    sure = [np.eye(4)[state] + 0.001 for state in (0, 1)]
    seen = [None, sure[0], None, None, sure[1], sure[1], None]
    assert most_likely_path(seen, seen, clamp) == [0, 0, 0, 0, 0, 1, 1]
