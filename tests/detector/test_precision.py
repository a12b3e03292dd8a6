from __future__ import annotations

from pathlib import Path

import pytest

from asdfviz.detector.precision import has_bfloat16


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("processor : 0\nflags : fpu avx512_bf16 sse\n", True),
        ("flags : fpu amx_bf16\n", True),
        ("flags : fpu avx2\nbugs : avx512_bf16\n", False),
        ("", False),
    ],
)
def test_it_is_read_from_the_processors_flags(
    monkeypatch: pytest.MonkeyPatch, text: str, wanted: bool
) -> None:
    monkeypatch.setattr(Path, "read_text", lambda *_, **__: text)
    has_bfloat16.cache_clear()
    assert has_bfloat16("cpu") is wanted
    has_bfloat16.cache_clear()


def test_unknown_devices_have_none() -> None:
    assert has_bfloat16("meta") is False
