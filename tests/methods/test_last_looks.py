"""What crops told of a part is known while it rests, and forgotten with it."""

from __future__ import annotations

from asdfviz.methods.looked_at import LastLooks, LookedAt


def look() -> LookedAt:
    return object.__new__(LookedAt)


def test_what_rests_keeps_its_last_look() -> None:
    looks, one, two = LastLooks(), look(), look()
    assert looks.step({"pin": one}, {"pin"}) == {"pin": one}
    assert looks.step({}, {"pin", "block"}) == {"pin": one}
    assert looks.step({"pin": two, "block": one}, {"pin", "block"}) == {"pin": two, "block": one}
    looks.rename({"pin": "pin-copy"})
    assert looks.step({}, {"pin-copy", "block"}) == {"pin-copy": two, "block": one}
    assert looks.step({}, {"block"}) == {"block": one}  # it was not detected
    assert looks.step({}, {"block", "pin-copy"}) == {"block": one}
