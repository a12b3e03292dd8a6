"""Names in narrow lists."""

from __future__ import annotations

import pytest

from asdfviz.app.naming import short_names


@pytest.mark.parametrize(
    ("names", "shorts"),
    [
        ([], []),
        (["Vise_State_0"], ["Vise_State_0"]),
        (["Vise_State_0", "Vise_State_1"], ["State_0", "State_1"]),
        (["V2_CLAMP_BALL", "V2_CLAMP_BASE", "V2_Link"], ["CLAMP_BALL", "CLAMP_BASE", "Link"]),
        (["HS_Pad", "HS_Pad-Copy"], ["Pad", "Pad-Copy"]),
        (["a - left", "a - right"], ["left", "right"]),
        (["a_", "a_b"], ["a_", "a_b"]),
        (["bolt", "base"], ["bolt", "base"]),
        (["pad", "pad-Copy"], ["pad", "pad-Copy"]),
    ],
)
def test_what_all_names_begin_with_is_left_out(names: list[str], shorts: list[str]) -> None:
    assert list(short_names(names).values()) == shorts
