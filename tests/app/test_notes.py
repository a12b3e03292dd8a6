"""Notes over the picture: what did not work stands longer, and once."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

from asdfviz.app.notes import MOST, Notes


@dataclass(eq=False)
class Note:
    """What the page is told of one note."""

    body: str
    seconds: float | None
    shown: list[Note]

    def remove(self) -> None:
        self.shown.remove(self)


@dataclass
class Tab:
    """viser's handle of a tab, as far as notes go."""

    shown: list[Note] = field(default_factory=list[Note])

    def add_notification(
        self, title: str, body: str, *, auto_close_seconds: float | None, **_more: Any
    ) -> Note:
        del title
        self.shown.append(Note(body, auto_close_seconds, self.shown))
        return self.shown[-1]


@pytest.fixture
def tab() -> Tab:
    return Tab()


def test_what_did_not_work_stands_longer_but_goes_by_itself(tab: Tab) -> None:
    notes = Notes(tab)
    notes.tell("That did not work", "no part is selected", color="red")
    notes.tell("Exported", "/there", color="green")
    notes.tell("Undo, redo", "nothing left to undo", color="gray")
    assert [note.seconds for note in tab.shown] == [12.0, 6.0, 6.0]


def test_a_problem_that_comes_again_stands_there_once(tab: Tab) -> None:
    notes = Notes(tab)
    for body in ("no part is selected", "no frame is left", "no part is selected"):
        notes.tell("That did not work", body, color="red")
    assert [note.body for note in tab.shown] == ["no frame is left", "no part is selected"]


def test_a_hint_that_comes_again_stands_there_once(tab: Tab) -> None:
    notes = Notes(tab)
    for _ in range(3):
        notes.tell("Undo, redo", "nothing left to undo", color="gray")
    assert len(tab.shown) == 1


def test_a_new_problem_is_seen_however_many_stand(tab: Tab) -> None:
    notes = Notes(tab)
    for number in range(MOST + 3):
        notes.tell("Frame cannot be read", str(number), color="red")
        notes.tell("Done", str(number), color="green")
    problems = [note.body for note in tab.shown if note.seconds == 12.0]
    assert problems == [str(number) for number in range(3, MOST + 3)]
