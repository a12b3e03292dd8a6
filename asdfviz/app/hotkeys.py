"""Every key and every command of the palette (Ctrl/Cmd+K), in one table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from asdfviz.app import actions as act
from asdfviz.datatypes import Assembly

Emit = Callable[[act.Action], None]


@dataclass(frozen=True, slots=True, eq=False)
class Hotkey:
    """One command."""

    group: str
    label: str
    action: act.Action
    key: str | None = None
    modifier: str | None = None
    on_sheet: bool = True


def _moves() -> tuple[Hotkey, ...]:
    """I K J L U O move right-handed in the picture; Shift turns about the same axes."""
    keys: tuple[tuple[str, act.Axis, act.Sign, str], ...] = (
        ("I", 1, -1, "up"),
        ("K", 1, 1, "down"),
        ("J", 0, -1, "left"),
        ("L", 0, 1, "right"),
        ("U", 2, -1, "nearer"),
        ("O", 2, 1, "farther"),
    )
    nudges = tuple(
        Hotkey("Correct", f"Nudge {way}", act.Nudge(axis, sign), key, on_sheet=False)
        for key, axis, sign, way in keys
    )
    # Turns are right-handed about the way that the key nudges.
    turns: tuple[tuple[str, act.Axis, act.Sign, str], ...] = (
        ("I", 1, -1, "Turn right"),
        ("K", 1, 1, "Turn left"),
        ("J", 0, -1, "Tip back"),
        ("L", 0, 1, "Tip forward"),
        ("U", 2, -1, "Roll left"),
        ("O", 2, 1, "Roll right"),
    )
    rotations = tuple(
        Hotkey("Correct", label, act.Turn(axis, sign), key, "shift", on_sheet=False)
        for key, axis, sign, label in turns
    )
    return (*nudges, *rotations)


HOTKEYS: tuple[Hotkey, ...] = (
    Hotkey("Watch", "Play, pause", act.TogglePlay(), "space"),
    Hotkey("Watch", "One frame back", act.Step(-1), "arrowleft"),
    Hotkey("Watch", "One frame on", act.Step(1), "arrowright"),
    Hotkey("Watch", "Ten frames back", act.Step(-10), "arrowleft", "shift"),
    Hotkey("Watch", "Ten frames on", act.Step(10), "arrowright", "shift"),
    Hotkey("Watch", "Previous state boundary", act.ToBoundary(-1), "pageup"),
    Hotkey("Watch", "Next state boundary", act.ToBoundary(1), "pagedown"),
    Hotkey("Watch", "Next frame without a pose", act.ToGap(1), "pagedown", "shift"),
    Hotkey("Watch", "Previous such frame", act.ToGap(-1), "pageup", "shift"),
    Hotkey("Watch", "First frame", act.Seek(0), "home"),
    Hotkey("Watch", "Last frame", act.Seek(10**8), "end"),
    Hotkey("Look", "AR, 3D", act.ToggleView(), "T"),
    Hotkey("Look", "Zoom in", act.Zoom(1.25), "Z"),
    Hotkey("Look", "Zoom out", act.Zoom(1 / 1.25), "Z", "shift"),
    Hotkey("Look", "Whole picture", act.FitView(), "F", "shift"),
    Hotkey("Look", "Meshes on, off", act.Toggle("overlay"), "H"),
    Hotkey("Look", "X-ray: only edges", act.Toggle("xray"), "X"),
    Hotkey("Look", "Boxes of the network", act.Toggle("boxes"), "B"),
    Hotkey("Look", "Keypoints of the network", act.Toggle("keypoints"), "Y"),
    *(
        Hotkey("Look", f"Outlines of layer {n}", act.ToggleLayerAt(n), str(n), on_sheet=False)
        for n in range(1, 10)
    ),
    Hotkey("State", "Next state of frame or range", act.NextState(1), "N", "shift"),
    Hotkey("State", "Previous state", act.NextState(-1), "P", "shift"),
    Hotkey("State", "Next error after this step", act.NextError(), "X", "shift"),
    Hotkey("State", "The state set last, once more", act.RepeatState(), "C", "shift"),
    Hotkey("State", "Take the state label away", act.ClearState(), "delete", "shift"),
    Hotkey("State", "Begin, end a range of frames", act.MarkRange(), "M"),
    Hotkey("Panel", "Sequence", act.ShowTab("sequence"), None, on_sheet=False),
    Hotkey("Panel", "Methods", act.ShowTab("methods"), None, on_sheet=False),
    Hotkey("Panel", "Annotate", act.ShowTab("annotate"), None, on_sheet=False),
    Hotkey("Panel", "Results", act.ShowTab("results"), None, on_sheet=False),
    Hotkey("Panel", "Judge the runs", act.Evaluate(), None, on_sheet=False),
    Hotkey("Panel", "Export as BOP", act.Export(), None, on_sheet=False),
    Hotkey("Panel", "This sheet", act.ToggleKeys(), "H", "shift", on_sheet=False),
    Hotkey("Correct", "Next part", act.NextPart(1), "N"),
    Hotkey("Correct", "Previous part", act.NextPart(-1), "P"),
    *_moves(),
    Hotkey("Correct", "Step size: fine, normal, coarse, large (45°)", act.CycleStep(), "0"),
    Hotkey("Correct", "Gizmo: move, turn, off", act.CycleGizmo(), "G"),
    Hotkey("Correct", "Copy the pose from the frame before, else after", act.CopyPrevious(), "C"),
    Hotkey("Correct", "Place the part in the frame", act.PlacePart(), "enter", "shift"),
    Hotkey("Correct", "Place what the state joins", act.PlaceJoined(), "G", "shift"),
    Hotkey("Correct", "Drop the correction", act.RevertPart(), "backspace", "shift"),
    Hotkey("Correct", "The pose is right: verified; or no longer", act.VerifyPart(), "V"),
    Hotkey("Correct", "The part is not in the frame", act.RemovePart(), "delete"),
    Hotkey("Correct", "Fit the part to the picture", act.FitPart(), "F"),
    Hotkey("Correct", "Track the part from here on", act.TrackPart("forward"), "R"),
    Hotkey("Correct", "Track the part from here back", act.TrackPart("back"), "R", "shift"),
    Hotkey("Correct", "Undo", act.Undo(), "Z", "cmd/ctrl"),
    Hotkey("Correct", "Redo", act.Redo(), "Z", "cmd/ctrl+shift"),
    Hotkey("Correct", "Cancel", act.Cancel(), "escape"),
)

KEY_NAMES = {
    "arrowleft": "←",
    "arrowright": "→",
    "pageup": "Page ↑",
    "pagedown": "Page ↓",
    "space": "Space",
    "home": "Home",
    "end": "End",
    "enter": "Enter",
    "escape": "Esc",
    "backspace": "⌫",
    "delete": "Del",
}
"""viser's names of keys, as a person reads them; the page puts these into viser's palette."""

SHARED_LINES = (
    ("Look", "1 to 9", "Blink the outlines of a run"),
    ("Panel", "? or Shift H", "This sheet"),
    ("Panel", "Ctrl K", "Palette: search all commands"),
    ("Correct", "I K J L U O", "Nudge up, down, left, right, nearer, farther"),
    ("Correct", "Shift + same", "Turn about the same axes"),
)
"""Keys that share a line of the sheet, the page's `?`, and the palette's, which is viser's own."""

MOUSE = (
    ("Wheel", "Zoom at the pointer"),
    ("Drag", "Move what is magnified; in 3D turn the scene"),
    ("Right drag", "In 3D move the scene"),
    ("Click a part", "Select it"),
    ("Drag its gizmo", "Move or turn it"),
    ("Shift click", "Put the selected part there"),
    ("Click, drag", "On the timeline: go to a frame"),
    ("Shift drag", "On the timeline: mark a range"),
    ("Click figures", "Type a frame's number, or a pose"),
)
"""What the mouse does in the picture and on the timeline."""


def sheet() -> dict[str, list[tuple[str, str]]]:
    """Keys and what they do, by group, as the sheet lists them."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for hotkey in HOTKEYS:
        if hotkey.on_sheet:
            groups.setdefault(hotkey.group, []).append((key_name(hotkey), hotkey.label))
    for group, keys, label in SHARED_LINES:
        groups.setdefault(group, []).append((keys, label))
    return {**groups, "Mouse": list(MOUSE)}


def key_name(hotkey: Hotkey) -> str:
    """The key as a person reads it."""
    modifiers = (hotkey.modifier or "").replace("cmd/ctrl", "Ctrl").replace("shift", "Shift")
    key = KEY_NAMES.get(hotkey.key or "", hotkey.key or "")
    return " ".join([*filter(None, modifiers.split("+")), key])


def state_commands(assembly: Assembly) -> tuple[Hotkey, ...]:
    """One command a state, so that the palette can set any of them."""
    return tuple(
        Hotkey(
            "State",
            f"Set {'error' if state.is_error else 'state'}: {state.name}",
            act.SetState(state.index),
            on_sheet=False,
        )
        for state in assembly.states
    )


def register(gui: Any, assembly: Assembly, emit: Emit) -> None:
    """Make every command known to one browser tab."""
    for hotkey in (*HOTKEYS, *state_commands(assembly)):
        command = gui.add_command(
            hotkey.label,
            description=hotkey.group,
            hotkey=hotkey.key,
            modifier=hotkey.modifier,
        )
        command.on_trigger(_sender(emit, hotkey.action))


def _sender(emit: Emit, action: act.Action) -> Callable[[object], Any]:
    async def send(_event: object) -> None:
        # async: viser runs these in order, while it may reorder those of its thread pool
        emit(act.ByKey(action))

    return send
