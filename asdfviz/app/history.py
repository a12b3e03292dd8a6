"""Steps that were undone or done again, and ranges, in words; which frame to look at afterwards. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from asdfviz.annotate.records import BY_STATE, TRACKED, Edit

_VERBS = {
    "pose": "moved",
    "remove_pose": "removed",
    "verify": "verified",
    "drop_pose": "drop of the correction of",
}
_PLACED = {"placed": "placed", "copied": "copied", "fitted": "fitted"}
"""The same of poses by their provenance."""
_DERIVATIONS = {TRACKED: "tracking", BY_STATE: "placing by the state"}
NAMED = 2
"""Parts that a step calls by name; of more it says how many."""


def in_words(step: Sequence[Edit]) -> str:
    """The edits of one step (at least one) as the history tells them."""
    told = [edit for edit in step if edit.kind != "seed"]
    if not told:
        return "what corrections start from"
    last = told[-1]
    where = _where(told)
    if last.kind == "state":
        name = last.payload.get("name") or last.payload.get("state")
        return f"state label taken from {where}" if name is None else f"state {name} in {where}"
    who = parts_in_words(str(edit.part) for edit in told)
    if last.payload.get("unverified"):
        return f"unverified {who} in {where}"
    if last.kind == "pose" and (deed := _DERIVATIONS.get(last.payload["provenance"])):
        return f"{deed} of {who} in {where}"
    verb = _PLACED.get(str(last.payload.get("provenance"))) if last.kind == "pose" else None
    return f"{verb or _VERBS[last.kind]} {who} in {where}"


def parts_in_words(parts: Iterable[str], kind: str = "parts") -> str:
    """Parts by name, each once; of many how many they are, and of what kind."""
    names = list(dict.fromkeys(parts))
    return " and ".join(names) if len(names) <= NAMED else f"{len(names)} {kind}"


def range_in_words(first: int | None, last: int | None) -> str:
    """Frames from the first to the last, by number."""
    return f"frame {first}" if first == last else f"frames {first} to {last}"


def _where(step: Sequence[Edit]) -> str:
    """The frames of a step: one or a range by number, several by how many they are."""
    spans = sorted({(edit.frame, edit.last_frame or edit.frame) for edit in step})
    if len(spans) > 1:
        return f"{len(spans)} frames"
    first, last = spans[0]
    return range_in_words(first, last)


def frames_of(step: Sequence[Edit]) -> set[int]:
    """The numbers of all frames that a step says something of."""
    return {
        frame
        for edit in step
        if edit.frame is not None
        for frame in range(edit.frame, (edit.last_frame or edit.frame) + 1)
    }


def place_to_show(places: Sequence[int], place: int) -> int:
    """The place to look at after a step that changed some: the nearest of them.

    A step of several frames is seen from within and from next to it, so nobody is led away from there:
    tracking begins beside the frames that it changes.
    """
    if not places:
        return place
    if len(places) > 1 and min(places) - 1 <= place <= max(places) + 1:
        return place
    return min(places, key=lambda other: abs(other - place))
