"""Runs one browser tab: takes actions from a queue, changes the view, the annotation or a job, and shows it.

viser calls back from many threads; callbacks only put actions into the queue. One thread a tab
empties it, so nothing here needs a lock, and no click is lost while something works.
"""

from __future__ import annotations

import contextlib
import threading
import time
import traceback
from collections.abc import Callable, Generator, Mapping
from dataclasses import replace
from typing import Any

from asdfviz.app import actions as act
from asdfviz.app import camera
from asdfviz.app.desk import Burst, NothingLeft, dragged
from asdfviz.app.display import Display
from asdfviz.app.editing import Edits, apply_edit, gap_beside, told_gap, use_base
from asdfviz.app.inbox import Inbox
from asdfviz.app.items import PROGRAM_FAULT
from asdfviz.app.jobs import Background
from asdfviz.app.places import edited
from asdfviz.app.playback import Pace, wait_until_shown
from asdfviz.app.session import asked_for, settled, update
from asdfviz.app.snapshot import take
from asdfviz.app.starting import begin_or_stop
from asdfviz.app.view import Facts, View
from asdfviz.app.welcome import is_first_visit, remember_visit
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AsdfvizError
from asdfviz.geometry.shapes import Intrinsics
from asdfviz.methods.spec import BrokenMethod, MethodSpec


class Controller:
    """One browser tab."""

    def __init__(
        self,
        client: Any,
        workspace: Workspace,
        background: Background,
        methods: Mapping[str, MethodSpec | BrokenMethod],
        *,
        heard: int = 0,
        on_shown: Callable[[], None] = lambda: None,
    ) -> None:
        """Get ready to serve a tab.

        Args:
            client: viser's handle of the tab.
            workspace: what all tabs share.
            background: what works for all of them.
            methods: everything that could be run.
            heard: so many of the workspace's messages are not told again.
            on_shown: called once, when the first picture stands in the tab.
        """
        self.client = client
        """viser's handle of the browser tab."""
        self._workspace = workspace
        self._background = background
        self._methods = methods
        self._inbox = Inbox()
        self.view = View(page=workspace.pages.open())
        self._burst = Burst()
        self._pace = Pace()
        self._status = ""
        self._carrying = workspace.carrying
        self._drag: act.MovePart | None = None
        self._heard = heard
        self._lens: Intrinsics | None = None
        self._on_shown = on_shown
        self._is_closed = False
        self._end = workspace.subscribe(lambda: self.emit(act.Changed()))
        self._thread = threading.Thread(target=self._work, name="tab", daemon=True)

    @property
    def is_dragging(self) -> bool:
        """Whether a gizmo is held."""
        return self._display.is_dragging

    def start(self) -> None:
        """Build the tab and serve it."""
        self._thread.start()

    def emit(self, action: act.Action) -> None:
        """Ask for something, from any thread."""
        self._inbox.put(action)

    def close(self) -> None:
        """The browser tab has gone."""
        self._is_closed = True
        self._workspace.pages.close(self.view.page)
        self._end()
        self._inbox.wake()

    @property
    def has_ended(self) -> bool:
        """Whether all that waited was dealt with after `close`."""
        return not self._thread.is_alive()

    def wait(self, seconds: float) -> None:
        """Wait for the thread to end."""
        self._thread.join(seconds)

    def _work(self) -> None:
        self._build()
        for begin in (self._changed, self._refresh, self._on_shown):
            with self._telling():
                begin()
        self._serve()
        self._keep_what_is_left()

    def _serve(self) -> None:
        while not self._is_closed:
            before = self.view.place
            for received in self._next_actions():
                self._handle(received)
            if self._is_closed:
                return
            with self._telling():
                self._show_what_is_new(before)

    def _show_what_is_new(self, before: int) -> None:
        """Show the view, which stood at the place before."""
        if self.view.playing:
            self._play()
        was_shown = self._refresh()
        moved = self.view.place != before
        if (moved or self.view.playing) and not was_shown:
            wait_until_shown(self.client)

    def _keep_what_is_left(self) -> None:
        """The tab may go while edits still wait; they are kept, and nobody is there to be told."""
        while left := self._inbox.take(0.0):
            for received in left:
                action = asked_for(self.view, received)
                if action is None:
                    continue
                self.view = update(self.view, action, self._facts())
                if isinstance(action, Edits):
                    with contextlib.suppress(AsdfvizError, OSError):
                        self._edit(action)

    def _build(self) -> None:
        workspace = self._workspace
        aspect = float(self.client.camera.aspect)
        base = workspace.base_of_seed()
        self.view = replace(
            self.view,
            aspect=aspect,
            base=base,
            chosen=base is not None,
            welcome=is_first_visit(self.client),
        )
        self._display = Display(self.client, workspace, self.emit, self._methods)
        camera.listen(self.client, lambda: self.view, self._facts, self.emit)

    def _facts(self) -> Facts:
        """What the view's rules depend on, by the camera of the picture that is shown."""
        facts = self._workspace.facts()
        return facts if self._lens is None else replace(facts, K=self._lens)

    def _next_actions(self) -> list[act.Action]:
        """Wait for actions, or while playing for the next frame's time; take all that are there."""
        wait = self._pace.wait_seconds(time.monotonic()) if self.view.playing else None
        return self._inbox.take(wait)

    def _handle(self, action: act.Action) -> None:
        with self._telling():
            self._act(action)

    @contextlib.contextmanager
    def _telling(self) -> Generator[None]:
        """Tell what goes wrong and go on: without its thread a tab would lose every later edit."""
        try:
            yield
        except NothingLeft as end:
            self._display.tell("Nothing left", str(end), color="gray")
        except (AsdfvizError, OSError) as error:
            self._failed(str(error))
        except Exception:  # noqa: BLE001 - whatever it is, the terminal tells
            with contextlib.suppress(OSError, ValueError):  # the terminal may be gone
                traceback.print_exc()
            self._failed(PROGRAM_FAULT)

    def _failed(self, why: str) -> None:
        self.view = replace(self.view, playing=False)  # the next frame might fail again
        self._display.tell("That did not work", why, color="red")

    def _act(self, received: act.Action) -> None:
        job = self._workspace.carrying
        is_tracking = job is not None and job.is_active
        action = asked_for(self.view, received, is_tracking=is_tracking)
        if action is None:
            return
        facts = self._facts()
        self.view = update(self.view, action, facts)
        match action:
            case act.MovePart(done=False):
                self._drag = action
            case act.Changed():
                self._changed()
            case act.Resume():
                self._workspace.pages.go_on(self.view.page, action.page)
            case act.DismissWelcome():
                remember_visit(self.client)
            case act.UseRun():
                use_base(self.view, self._workspace, now=time.monotonic())
            case act.ToGap():
                self._to_gap(action)
            case _:
                if isinstance(action, Edits):
                    self._edit(action)
                else:
                    self.view = begin_or_stop(
                        action, self.view, self._workspace, self._background, self._methods
                    )

    def _edit(self, action: Edits) -> None:
        self._drag = None
        now = time.monotonic()
        done = apply_edit(action, self.view, self._workspace, burst=self._burst, now=now)
        self._burst = done.burst
        self._status = f"{done.message}, saved"
        facts = self._facts()
        self.view = edited(self.view, action, done.place, facts, state=done.state)
        self._follow_seed()
        self._workspace.changed()

    def _to_gap(self, action: act.ToGap) -> None:
        """Go where a pose is missing."""
        place = gap_beside(self.view, self._workspace, action.direction)
        self.view = update(self.view, act.Hold(place), self._facts())
        self._status = told_gap(self.view, self._workspace)

    def _follow_seed(self) -> None:
        """Draw what corrections start from, in every tab: that is also what is exported."""
        if (base := self._workspace.base_of_seed()) is not None:
            self.view = replace(self.view, base=base, chosen=True)

    def _changed(self) -> None:
        facts = self._facts()
        self._follow_seed()
        self.view = settled(self.view, facts)
        messages = self._workspace.messages
        for message in messages[self._heard :]:
            self._display.tell(
                message.title, message.body, color="red" if message.is_problem else "green"
            )
        self._heard = len(messages)
        carrying = self._workspace.carrying
        if carrying is not None and carrying is not self._carrying and carrying.state == "done":
            lost = f"; {carrying.message}" if carrying.message else ""
            self._status = f"{carrying.told}, saved{lost}"
        self._carrying = carrying

    def _play(self) -> None:
        now = time.monotonic()
        if self._pace.wait_seconds(now) > 0:
            return
        facts = self._facts()
        self.view = update(self.view, act.Seek(self.view.place + 1), facts)
        if self.view.place == facts.count - 1:
            self.view = replace(self.view, playing=False)
        self._pace.advance(now, 1.0 / (self._workspace.fps * self.view.speed))

    def _refresh(self) -> bool:
        """Show the view; True where the page has answered meanwhile, so that it keeps up."""
        view = self.view
        if not view.playing:
            self._pace.reset()
        frame = self._display.frame(view.place)
        snap = take(self._workspace, view, frame=frame, status=self._status)
        self._lens = snap.facts.K
        if self._drag is not None and self._drag.place == view.place:
            snap.poses.update(dragged(self._workspace, view, self._drag))
        return self._display.show(snap)
