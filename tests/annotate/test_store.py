"""The edit file: exact, undoable, shared, and safe from crashes and strangers."""

from __future__ import annotations

import os
import re
import signal
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from asdfviz.annotate.edit_file import open_step
from asdfviz.annotate.records import Seed, StateLabel
from asdfviz.annotate.steps import group_of
from asdfviz.annotate.store import AnnotationStore
from asdfviz.errors import AnnotationError
from asdfviz.geometry.transforms import rotation_about, transform_from

OpenStore = Callable[..., AnnotationStore]


def pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return transform_from(rotation_about(rng.normal(size=3), rng.uniform(0, 3)), rng.normal(size=3))


def kept(store: AnnotationStore, frame: int = 0, part: str = "lid") -> np.ndarray | None:
    found = store.pose(frame, part)
    return None if found is None else found.T_camera_part


def test_an_empty_store_knows_nothing(store: AnnotationStore) -> None:
    assert store.pose(0, "lid") is None
    assert store.state(0) is None
    assert store.seed() == Seed()
    assert store.poses() == {}
    assert store.history() == ()
    assert store.version() == 0
    assert store.undo() == store.redo() == ()


def test_a_block_of_edits_is_kept_whole_or_not_at_all(store: AnnotationStore) -> None:
    with store.transaction():
        store.set_pose(0, "lid", pose(1), group="one")
        store.remove_pose(1, "lid", group="one")

    def broken() -> None:
        with store.transaction():
            store.remove_pose(2, "lid", group="two")
            store.set_pose(3, "lid", np.zeros((4, 4)), group="two")

    with pytest.raises(AnnotationError, match="rigid"):
        broken()
    assert {frame for frame, _ in store.poses()} == {0, 1}
    assert len(store.undo()) == 2
    assert store.poses() == {}


def test_a_pose_comes_back_to_the_last_bit(open_store: OpenStore) -> None:
    first = open_store()
    for seed in range(50):
        first.set_pose(seed, "lid", pose(seed), provenance="gizmo")
    first.close()
    second = open_store("bob")
    for seed in range(50):
        found = second.pose(seed, "lid")
        assert found is not None
        assert found.T_camera_part is not None
        np.testing.assert_array_equal(found.T_camera_part, pose(seed))
        assert not found.T_camera_part.flags.writeable
        assert (found.provenance, found.author, found.verified) == ("gizmo", "ada", False)


def test_every_edit_is_a_row_with_author_and_time(store: AnnotationStore) -> None:
    before = datetime.now(UTC)
    store.set_pose(3, "lid", pose(0))
    store.set_state(3, StateLabel(1), last_frame=9)
    store.undo()
    rows = sqlite3.connect(store.path).execute("SELECT id, author, kind, time FROM edits")
    found = rows.fetchall()
    rows.connection.close()
    assert [row[:3] for row in found] == [
        *((1, "ada", "pose"), (2, "ada", "state"), (3, "ada", "undo"))
    ]
    times = [datetime.fromisoformat(row[3]) for row in found]
    assert before <= times[0] <= times[1] <= times[2] <= datetime.now(UTC)


def test_going_on_with_a_step_reads_no_more_after_many_edits(store: AnnotationStore) -> None:
    def turns_of_loops() -> int:
        turns: list[None] = []
        with store.transaction() as connection:
            connection.set_progress_handler(lambda: turns.append(None), 1)
            open_step(connection, store.author, "drag")
            connection.set_progress_handler(None, 1)
        return len(turns)

    store.set_pose(0, "lid", pose(0))
    few = turns_of_loops()
    store.set_frames({frame: {"lid": pose(0)} for frame in range(500)}, provenance="tracked")
    assert turns_of_loops() == few


def test_undo_and_redo(store: AnnotationStore) -> None:
    for seed in (1, 2, 3):
        store.set_pose(0, "lid", pose(seed))
    undone = store.undo()
    assert [(edit.kind, edit.frame, edit.part) for edit in undone] == [("pose", 0, "lid")]
    np.testing.assert_array_equal(kept(store), pose(2))
    store.undo()
    np.testing.assert_array_equal(kept(store), pose(1))
    store.redo()
    np.testing.assert_array_equal(kept(store), pose(2))
    store.redo()
    np.testing.assert_array_equal(kept(store), pose(3))
    assert store.redo() == ()
    for _ in range(3):
        assert store.undo()
    assert kept(store) is None
    assert store.undo() == ()
    store.redo()
    store.set_pose(0, "lid", pose(9))
    assert store.redo() == ()  # a new edit ends what could be brought back
    assert len(store.history()) == 3 + 2 + 2 + 3 + 1 + 1


def test_undo_reaches_back_over_a_restart(open_store: OpenStore) -> None:
    first = open_store()
    for seed in range(120):
        first.set_pose(0, "lid", pose(seed))
    first.close()
    second = open_store()
    for _ in range(119):
        second.undo()
    np.testing.assert_array_equal(kept(second), pose(0))
    second.close()
    third = open_store()
    for _ in range(119):
        third.redo()
    np.testing.assert_array_equal(kept(third), pose(119))


def test_undo_leaves_the_steps_of_another_tab_alone(store: AnnotationStore) -> None:
    left, right = group_of("left", "edit@1"), group_of("right", "edit@2")
    store.set_seed(Seed("truth"), group=left)
    store.set_pose(0, "lid", pose(1), group=left)
    store.set_pose(5, "pin", pose(2), group=right)
    (_, undone) = store.undo(others=["right"], group=left)
    assert (undone.frame, undone.part) == (0, "lid")
    assert set(store.poses()) == {(5, "pin")}
    assert store.undo(others=["right"], group=left) == ()
    # What the other tab's corrections start from was not taken from under them.
    assert store.seed() == Seed("truth")
    assert store.redo(others=["left"], group=right) == ()
    assert len(store.redo(others=["right"], group=left)) == 2
    assert len(store.undo(others=["left"], group=right)) == 2
    assert set(store.poses()) == {(0, "lid")}
    assert store.seed() == Seed("truth")
    store.redo(group=left)  # a tab that is closed leaves its steps to the others
    assert set(store.poses()) == {(0, "lid"), (5, "pin")}


def test_undo_says_what_another_tab_has_changed_since(store: AnnotationStore) -> None:
    left, right = group_of("left", "edit@1"), group_of("right", "edit@2")
    store.set_pose(0, "lid", pose(1), group=left)
    store.remove_pose(0, "lid", group=right)
    with pytest.raises(AnnotationError, match="another tab has changed lid in frame 0 since"):
        store.undo(others=["right"], group=left)
    store.undo(others=["left"], group=right)
    assert len(store.undo(others=["right"], group=left)) == 1
    store.set_state(3, StateLabel(0), last_frame=6, group=left)
    store.set_state(6, StateLabel(1), last_frame=9, group=right)
    with pytest.raises(AnnotationError, match="another tab has changed the state of frame 6 since"):
        store.undo(others=["right"], group=left)
    store.set_state(7, StateLabel(0), group=f"{right}0")
    store.undo(others=["left"], group=right)
    store.undo(others=["left"], group=right)
    assert len(store.undo(others=["right"], group=left)) == 1
    for name in ("left", "right"):
        store.set_seed(Seed("run", name), group=group_of(name, "base@3"))
    with pytest.raises(AnnotationError, match="changed what corrections start from since"):
        store.undo(others=["right"], group=left)


def test_undo_takes_back_ones_own_edits_only(open_store: OpenStore) -> None:
    ada, bob = open_store("ada"), open_store("bob")
    ada.set_pose(0, "lid", pose(1))
    bob.set_pose(0, "lid", pose(2))
    bob.set_pose(1, "pin", pose(3))
    # Bob's came later and stands: taking back what lies under it would change nothing that is seen.
    with pytest.raises(AnnotationError, match="bob has changed lid in frame 0 since: it is theirs"):
        ada.undo()
    bob.undo()
    assert kept(ada, 1, "pin") is None
    bob.undo()
    np.testing.assert_array_equal(kept(bob), pose(1))
    ada.undo()
    assert kept(ada) is None
    assert ada.undo() == ()
    ada.redo()
    np.testing.assert_array_equal(kept(bob), pose(1))
    # Ada's edits do not end what Bob can bring back.
    bob.redo()
    np.testing.assert_array_equal(kept(ada), pose(2))


def test_undo_leaves_what_somebody_elses_corrections_start_from(open_store: OpenStore) -> None:
    ada, bob = open_store("ada"), open_store("bob")
    ada.set_seed(Seed("truth"), group="first edit")
    ada.set_pose(0, "lid", pose(1), group="first edit")
    bob.set_pose(5, "pin", pose(2))
    bob.set_pose(6, "pin", pose(3))
    bob.undo()
    assert len(ada.undo()) == 2
    assert set(bob.poses()) == {(5, "pin")}
    assert bob.seed() == Seed("truth")
    assert len(bob.redo()) == 1  # that the seed came to Bob's step ends nothing
    bob.undo()
    bob.undo()
    assert bob.seed() == Seed("none")


def test_undo_leaves_the_seed_that_another_tab_chose_since(store: AnnotationStore) -> None:
    left, right = group_of("left", "edit@1"), group_of("right", "edit@2")
    run = Seed("run", "asdf", "asdf")
    store.set_seed(Seed("truth"), group=left)
    store.set_pose(0, "lid", pose(1), group=left)
    store.set_seed(run, group=right)
    store.undo(others=["right"], group=left)
    assert store.seed() == run
    store.redo(others=["right"], group=left)
    store.undo(others=["left"], group=right)
    assert store.seed() == Seed("truth")


def test_what_rests_on_a_seed_keeps_it_under_a_later_choice(store: AnnotationStore) -> None:
    left, right = group_of("left", "edit@1"), group_of("right", "edit@2")
    run = Seed("run", "asdf", "asdf")
    store.set_seed(Seed("truth"), group=left)
    store.set_pose(0, "lid", pose(1), group=left)
    store.set_pose(5, "pin", pose(2), group=right)
    store.set_seed(run, group=group_of("right", "base@3"))
    store.undo(others=["right"], group=left)
    assert store.seed() == run
    store.undo(others=["left"], group=right)
    assert store.seed() == Seed("truth")


def test_a_drag_is_one_step(store: AnnotationStore) -> None:
    store.set_pose(0, "lid", pose(0))
    for seed in range(1, 20):
        store.set_pose(0, "lid", pose(seed), group="drag 1")
    store.set_pose(0, "lid", pose(30), group="drag 2")
    assert len(store.history()) == 21
    store.undo()
    np.testing.assert_array_equal(kept(store), pose(19))
    assert len(store.undo()) == 19
    np.testing.assert_array_equal(kept(store), pose(0))
    store.redo()
    np.testing.assert_array_equal(kept(store), pose(19))


def test_a_group_name_that_comes_again_is_a_new_step(store: AnnotationStore) -> None:
    store.set_pose(0, "lid", pose(0), group="keys")
    store.set_pose(0, "pin", pose(1))
    store.set_pose(0, "lid", pose(2), group="keys")
    assert len(store.undo()) == 1
    np.testing.assert_array_equal(kept(store), pose(0))
    store.set_pose(0, "lid", pose(3), group="keys")  # after an undo, too
    store.undo()
    np.testing.assert_array_equal(kept(store), pose(0))


def test_several_parts_move_as_one_step(store: AnnotationStore) -> None:
    store.set_poses(4, {"base": pose(0), "lid": pose(1)}, provenance="group")
    assert set(store.poses(4)) == {(4, "base"), (4, "lid")}
    store.undo()
    assert store.poses(4) == {}
    with pytest.raises(AnnotationError, match="without any part"):
        store.set_poses(4, {})


def test_remove_and_verify(store: AnnotationStore) -> None:
    store.verify(0, "lid", pose(1), provenance="method:asdf")
    found = store.pose(0, "lid")
    assert found is not None
    assert (found.verified, found.provenance) == (True, "method:asdf")
    np.testing.assert_array_equal(kept(store), pose(1))
    store.remove_pose(0, "lid")
    found = store.pose(0, "lid")
    assert found is not None
    assert found.T_camera_part is None
    store.undo()
    np.testing.assert_array_equal(kept(store), pose(1))


def test_states_of_ranges(store: AnnotationStore) -> None:
    store.set_state(10, StateLabel(0), last_frame=30)
    store.set_state(
        20, StateLabel(1, is_error=True, name="lid wrong", attached=("base",)), last_frame=25
    )
    store.set_state(22, None)
    states = {frame: store.state(frame) for frame in (9, 10, 19, 20, 22, 25, 26, 30, 31)}
    assert states[9] is states[31] is states[22] is None
    assert states[10] == states[19] == states[26] == states[30] == StateLabel(0)
    assert states[20] == states[25] == StateLabel(1, True, "lid wrong", ("base",))
    store.undo()
    store.undo()
    assert store.state(22) == StateLabel(0)
    with pytest.raises(AnnotationError, match="ends at 3, before its start 5"):
        store.set_state(5, StateLabel(0), last_frame=3)


def test_the_seed_is_kept(open_store: OpenStore) -> None:
    seed = Seed("run", "/runs/asdf", "asdf")
    first = open_store()
    first.set_seed(seed, group="first edit")
    first.set_pose(0, "lid", pose(0), group="first edit")
    second = open_store("bob")
    assert second.seed() == seed
    assert second.seed().provenance == "method:asdf"
    first.undo()
    assert second.seed() == Seed("none")
    assert kept(second) is None


@pytest.mark.parametrize(
    "bad", [np.zeros((4, 4)), np.full((4, 4), np.nan), np.diag([1.0, 1, -1, 1]), np.eye(4) * 2]
)
def test_a_pose_that_is_none_is_refused(store: AnnotationStore, bad: np.ndarray) -> None:
    with pytest.raises(AnnotationError, match="rigid"):
        store.set_pose(0, "lid", bad)
    assert store.version() == 0


def test_two_stores_see_each_other(open_store: OpenStore) -> None:
    ada, bob = open_store("ada"), open_store("bob")
    seen = ada.version()
    bob.set_pose(5, "pin", pose(5))
    assert ada.version() > seen
    (edit,) = ada.history(after=seen)
    assert (edit.author, edit.frame, edit.part) == ("bob", 5, "pin")
    seen = ada.version()
    bob.undo()
    assert ada.version() > seen
    assert kept(ada, 5, "pin") is None


def test_threads_and_stores_at_once_lose_nothing(open_store: OpenStore) -> None:
    stores = [open_store(name) for name in ("ada", "bob")]
    failures: list[Exception] = []

    def work(number: int) -> None:
        try:
            for frame in range(25):
                stores[number % 2].set_pose(frame, f"part{number}", pose(frame))
        except AnnotationError as error:
            failures.append(error)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert failures == []
    assert len(stores[0].poses()) == 100


WRITER = """
import sys
import numpy as np
from pathlib import Path
from asdfviz.annotate.store import AnnotationStore

store = AnnotationStore(Path(sys.argv[1]), sequence_name="clip", assembly_name="boxes", author="ada")
T_camera_part = np.eye(4)
for frame in range(100_000):
    T_camera_part[0, 3] = frame / 7
    store.set_pose(frame, "lid", T_camera_part)
    print(frame, flush=True)
"""


def test_a_killed_process_loses_no_edit(open_store: OpenStore, tmp_path: Path) -> None:
    file = tmp_path / "notes" / "clip.db"
    for wanted in (1, 15, 60):
        file.unlink(missing_ok=True)
        for suffix in ("-wal", "-shm"):
            file.with_name(file.name + suffix).unlink(missing_ok=True)
        with subprocess.Popen(
            [sys.executable, "-c", WRITER, str(file)], stdout=subprocess.PIPE, text=True
        ) as process:
            assert process.stdout is not None
            told = -1
            for line in process.stdout:
                told = int(line)
                if told >= wanted:
                    os.kill(process.pid, signal.SIGKILL)
                    break
            told = max([told, *(int(line) for line in process.stdout.read().split())])
        store = open_store()
        poses = store.poses()
        assert set(range(told + 1)) <= {frame for frame, _ in poses}
        last = poses[told, "lid"].T_camera_part
        assert last is not None
        assert last[0, 3] == told / 7
        store.set_pose(0, "lid", pose(0))
        store.close()


def test_the_wrong_sequence_or_assembly_is_refused(open_store: OpenStore) -> None:
    store = open_store()
    store.set_pose(0, "lid", pose(0))
    store.close()
    before = store.path.read_bytes()
    with pytest.raises(AnnotationError, match="of sequence 'clip', not 'other'"):
        open_store(sequence="other")
    with pytest.raises(AnnotationError, match="of assembly 'boxes', not 'vise'"):
        open_store(assembly="vise")
    assert store.path.read_bytes() == before


def test_another_assembly_may_have_a_file_without_edits(open_store: OpenStore) -> None:
    open_store(assembly="vise").close()
    store = open_store()
    store.set_pose(0, "lid", pose(0))
    store.undo()
    store.close()
    with pytest.raises(AnnotationError, match="of assembly 'boxes', not 'vise'"):
        open_store(assembly="vise")
    assert open_store().redo() != ()


def damaged(content: bytes, case: str) -> bytes:
    if case == "cut":
        return content[: len(content) // 2]
    if case == "pages":
        return content[:4096] + b"\xa5" * (len(content) - 4096)
    if case == "header":
        return b"\0" * 100 + content[100:]
    return b"notes: none\n"


@pytest.mark.parametrize("case", ["cut", "pages", "header", "text"])
def test_a_damaged_file_is_told_and_left(open_store: OpenStore, case: str) -> None:
    store = open_store()
    for frame in range(40):
        store.set_pose(frame, "lid", pose(frame))
    store.close()
    content = damaged(store.path.read_bytes(), case)
    store.path.write_bytes(content)
    with pytest.raises(AnnotationError, match=re.escape(str(store.path))):
        open_store()
    assert store.path.read_bytes() == content


def test_a_newer_or_foreign_database_is_refused(open_store: OpenStore, tmp_path: Path) -> None:
    store = open_store()
    store.close()
    for pragma, message in (
        ("user_version = 99", "version 99.*update"),
        ("application_id = 7", "something else"),
    ):
        connection = sqlite3.connect(store.path)
        connection.execute(f"PRAGMA {pragma}")
        connection.close()
        before = store.path.read_bytes()
        with pytest.raises(AnnotationError, match=message):
            open_store()
        assert store.path.read_bytes() == before


def test_an_empty_file_and_left_overs_are_no_obstacle(
    open_store: OpenStore, tmp_path: Path
) -> None:
    file = tmp_path / "notes" / "clip.db"
    file.parent.mkdir()
    file.touch()
    open_store().set_pose(0, "lid", pose(0))
    assert kept(open_store("bob")) is not None
    assert [path.name for path in file.parent.iterdir() if path.name.startswith(".")] == []


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(AnnotationError, match="cannot be opened"):
        AnnotationStore(tmp_path / "file" / "a.db", sequence_name="a", assembly_name="b")


def test_a_closed_store_says_so(store: AnnotationStore) -> None:
    store.close()
    with pytest.raises(AnnotationError, match="cannot be written"):
        store.set_pose(0, "lid", pose(0))
    with pytest.raises(AnnotationError, match="cannot be read"):
        store.version()


@pytest.mark.parametrize("case", ["deleted", "replaced"])
def test_a_file_that_goes_while_it_is_open_keeps_no_edit(store: AnnotationStore, case: str) -> None:
    store.set_pose(0, "lid", pose(0))
    aside = store.path.with_name("aside.db")
    store.path.rename(aside)
    if case == "replaced":
        store.path.write_bytes(aside.read_bytes())
    for write in (store.undo, lambda: store.set_pose(1, "lid", pose(1))):
        with pytest.raises(AnnotationError, match=r"clip\.db has gone .* the edit was not kept"):
            write()
    aside.replace(store.path)
    store.set_pose(2, "lid", pose(2))
    assert [frame for frame, _ in store.poses()] == [0, 2]
