"""The HTML of one browser tab: which field holds what, and sending only what changed."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from typing import Any

from asdfviz.app import actions as act
from asdfviz.app import chrome, timeline, welcome
from asdfviz.app.bridge import parse
from asdfviz.app.hotkeys import KEY_NAMES
from asdfviz.app.markup import mount
from asdfviz.app.panels import annotate, methods, options, results, sequence
from asdfviz.app.resuming import kept
from asdfviz.app.snapshot import Snapshot
from asdfviz.methods.spec import BrokenMethod, MethodSpec


class Page:
    """The fields of one tab. Those of the frame around the picture are templates that the page's
    script puts into place (static/app.js); the panel's content stands where viser puts it.
    """

    def __init__(
        self,
        gui: Any,
        available: Mapping[str, MethodSpec | BrokenMethod],
        emit: Callable[[act.Action], None],
        *,
        opened: str,
        path: str,
    ) -> None:
        """Make the fields.

        Args:
            gui: viser's handle of the tab's panel.
            available: everything that could be run.
            emit: called with what the page's script asks for.
            opened: tells a page that is loaded again whether it is still the same opening.
            path: tells a page that lost its connection whether it is still the same sequence.
        """
        self._available = available
        self._bridge = gui.add_text("bridge", "", visible=False)
        self._bridge.on_update(self._receiver(emit))
        slots = ("bridge", "top", "tabs", "controls", "timeline", "view", "card")
        self._fields = {slot: gui.add_html("") for slot in slots}
        self._panel = gui.add_html("")
        self._sent: dict[str, str] = {}
        # The script needs the hidden field's id, which viser has no public name for.
        uuid: str = self._bridge._impl.uuid
        names = json.dumps(KEY_NAMES)
        made = mount("bridge", "", uuid=uuid, opened=opened, sequence=path, keys=names)
        self._put("bridge", made)

    def show(self, snap: Snapshot) -> None:
        """Bring every field to a snapshot."""
        self._put("top", mount("top", chrome.top_bar(snap)))
        self._put("tabs", mount("tabs", chrome.tabs(snap.view)))
        self._put("controls", mount("controls", chrome.controls(snap)))
        self._put("timeline", mount("timeline", chrome.timeline_rows(snap)))
        self._put("view", self._view(snap))
        self._put("card", mount("card", self._card(snap)))
        content = f'<div class="ax-panel" data-tab="{snap.view.tab}">{self._tab(snap)}</div>'
        if self._sent.get("panel") != content:
            self._sent["panel"] = content
            self._panel.content = content

    def _receiver(self, emit: Callable[[act.Action], None]) -> Callable[[object], Any]:
        async def receive(_event: object) -> None:
            action = parse(self._bridge.value)
            if action is not None:
                emit(action)

        return receive

    def _tab(self, snap: Snapshot) -> str:
        match snap.view.tab:
            case "sequence":
                return sequence.content(snap)
            case "methods":
                return methods.content(snap, self._available)
            case "annotate":
                return annotate.content(snap)
            case "results":
                return results.content(snap)

    def _view(self, snap: Snapshot) -> str:
        """What the script itself has to know: it moves the cursor, guards keys and wheel, and keeps the
        view for when the page comes back.
        """
        view, count = snap.view, snap.facts.count
        first, last = view.marked or (-1, -1)
        return mount(
            "view",
            "",
            kept=json.dumps(dataclasses.asdict(kept(view))),
            mode=view.mode,
            zoom=f"{view.zoom:.4f}",
            count=count,
            place=view.place,
            cursor=f"{timeline.cursor_share(view.place, count):.6f}",
            first=first,
            last=last,
            opacity=f"{view.opacity:.2f}",
            title=snap.workspace.frames.name,
        )

    def _card(self, snap: Snapshot) -> str:
        if snap.view.keys:
            return chrome.keys_sheet()
        asked = snap.view.asking
        spec = self._available.get(asked or "")
        if asked is not None and isinstance(spec, MethodSpec):
            chosen = snap.view.options.get(asked, {})
            return options.card(asked, spec, snap.workspace.assembly, chosen)
        return welcome.card() if snap.view.welcome else ""

    def _put(self, slot: str, content: str) -> None:
        if self._sent.get(slot) != content:
            self._sent[slot] = content
            self._fields[slot].content = content
