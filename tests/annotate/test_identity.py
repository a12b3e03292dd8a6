"""Two captures in folders of one name keep their corrections apart; a moved one finds its own."""

from __future__ import annotations

import hashlib
import json
import shutil
import sqlite3
from pathlib import Path

import cv2
import numpy as np
import pytest

from asdfviz.annotate.identity import open_annotation, own_annotation_file, sequence_identity
from asdfviz.annotate.store import AnnotationStore
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Assembly, Sequence
from asdfviz.errors import AnnotationError


def capture(folder: Path, assembly: Assembly, *, light: int) -> Sequence:
    """Eight small pictures, ever lighter."""
    for room, kind in (("rgb", np.uint8), ("depth", np.uint16)):
        (folder / "take" / room).mkdir(parents=True)
        for number in range(8):
            pixels = np.full((6, 8), light + number, kind)
            cv2.imwrite(str(folder / "take" / room / f"{number:06d}.png"), pixels)
    write_camera(folder / "take", focal=9.0)
    return open_sequence(folder / "take", assembly=assembly)


def write_camera(scene: Path, *, focal: float) -> None:
    camera = {"fx": focal, "fy": focal, "cx": 4, "cy": 3, "width": 8, "height": 6}
    (scene / "camera.json").write_text(json.dumps({**camera, "depth_scale": 1.0}))


def names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.glob("*.db"))


def authors_capture(folder: Path, kind: str, assembly: Assembly, *, light: int) -> Sequence:
    """One frame as the authors' renderer wrote it, or as they exported it for training."""
    rooms = ("Images", "depth_images") if kind == "renderer" else ("images", "labels")
    for room in rooms:
        (folder / "take" / room).mkdir(parents=True)
    write_camera(folder / "take", focal=9.0)
    if kind == "renderer":
        cv2.imwrite(str(folder / "take/Images/000000.png"), np.full((6, 8, 3), light, np.uint8))
        depth = np.full((6, 8), 500, np.uint16)
        cv2.imwrite(str(folder / "take/depth_images/000000.png"), depth)
    else:
        both = np.full((6, 8, 4), light * 256, np.uint16)
        cv2.imwrite(str(folder / "take/images/000000.png"), both)
        (folder / "take/labels/000000.txt").write_text("")
    return open_sequence(folder / "take", assembly=assembly)


@pytest.mark.parametrize("kind", ["renderer", "export"])
def test_pictures_of_the_authors_formats_tell_sequences_apart(
    tmp_path: Path, kind: str, boxes: Assembly
) -> None:
    captures = [
        authors_capture(tmp_path / day, kind, boxes, light=light)
        for day, light in (("monday", 10), ("tuesday", 20))
    ]
    assert len({sequence_identity(sequence) for sequence in captures}) == 2


def test_sequences_of_one_name_have_files_of_their_own(tmp_path: Path, boxes: Assembly) -> None:
    notes = tmp_path / "notes"
    monday, tuesday = (
        capture(tmp_path / day, boxes, light=light)
        for day, light in (("monday", 10), ("tuesday", 20))
    )
    for sequence, frame in ((monday, 0), (tuesday, 1)):
        with open_annotation(sequence, boxes, folder=notes) as store:
            store.set_pose(frame, "lid", np.eye(4))
    assert names(notes) == ["take-2.db", "take.db"]
    for sequence, frame in ((tuesday, 1), (monday, 0)):
        with open_annotation(sequence, boxes, folder=notes) as store:
            assert list(store.poses()) == [(frame, "lid")]


def test_a_moved_or_grown_sequence_finds_its_file(tmp_path: Path, boxes: Assembly) -> None:
    notes = tmp_path / "notes"
    first = capture(tmp_path / "here", boxes, light=10)
    with open_annotation(first, boxes, folder=notes) as store:
        store.set_pose(0, "lid", np.eye(4))
    shutil.move(tmp_path / "here", tmp_path / "there")
    scene = tmp_path / "there" / "take"
    write_camera(scene, focal=10.0)
    shutil.copy(scene / "rgb" / "000001.png", scene / "rgb" / "000008.png")
    moved = open_sequence(scene, assembly=boxes)
    with open_annotation(moved, boxes, folder=notes) as store:
        assert list(store.poses()) == [(0, "lid")]
    assert names(notes) == ["take.db"]


def test_a_file_from_before_identities_is_taken_by_the_first_that_opens_it(
    tmp_path: Path, boxes: Assembly
) -> None:
    old = tmp_path / "take.db"
    with AnnotationStore(old, sequence_name="take", assembly_name="boxes") as store:
        store.set_pose(0, "lid", np.eye(4))
    monday, tuesday = (
        capture(tmp_path / day, boxes, light=light)
        for day, light in (("monday", 10), ("tuesday", 20))
    )
    with open_annotation(monday, boxes, folder=tmp_path) as store:
        assert list(store.poses()) == [(0, "lid")]
    assert own_annotation_file(tuesday, folder=tmp_path) == tmp_path / "take-2.db"
    with pytest.raises(AnnotationError, match="another sequence called 'take'"):
        AnnotationStore(
            old, sequence_name="take", assembly_name="boxes", identity=sequence_identity(tuesday)
        )


def test_a_damaged_file_is_said_and_not_passed_over(tmp_path: Path, boxes: Assembly) -> None:
    (tmp_path / "take.db").write_text("no database at all, but something of somebody's")
    with pytest.raises(AnnotationError, match=r"take\.db is not an annotation file"):
        open_annotation(capture(tmp_path / "x", boxes, light=10), boxes, folder=tmp_path)
    assert names(tmp_path) == ["take.db"]


def test_finding_a_file_changes_nothing(tmp_path: Path, boxes: Assembly) -> None:
    sequence = capture(tmp_path / "x", boxes, light=10)
    assert own_annotation_file(sequence, folder=tmp_path) == tmp_path / "take.db"
    assert names(tmp_path) == []
    open_annotation(sequence, boxes, folder=tmp_path).close()
    connection = sqlite3.connect(tmp_path / "take.db")
    found = dict(connection.execute("SELECT key, value FROM about"))
    connection.close()
    assert found["identity"] == sequence_identity(sequence)


def test_stray_files_do_not_change_a_sequence(tmp_path: Path, boxes: Assembly) -> None:
    sequence = capture(tmp_path, boxes, light=10)
    before = sequence_identity(sequence)
    for name in (".DS_Store", "._000000.png", "Thumbs.db", ".000000.png.a1b2c3"):
        (Path(sequence.path) / "rgb" / name).write_bytes(b"x")
    assert sequence_identity(sequence) == before


def test_a_short_capture_that_goes_on_keeps_its_file(tmp_path: Path, boxes: Assembly) -> None:
    sequence = capture(tmp_path, boxes, light=10)
    scene, notes = Path(sequence.path), tmp_path / "notes"
    last = sorted((scene / "rgb").iterdir())[5:]
    kept = {file: file.read_bytes() for file in last}
    for file in last:
        file.unlink()
    with open_annotation(open_sequence(scene, assembly=boxes), boxes, folder=notes) as store:
        store.set_pose(0, "lid", np.eye(4))
    for file, content in kept.items():
        file.write_bytes(content)
    with open_annotation(open_sequence(scene, assembly=boxes), boxes, folder=notes) as store:
        assert store.pose(0, "lid") is not None
    other = capture(tmp_path / "other", boxes, light=90)
    assert own_annotation_file(other, folder=notes).name == "take-2.db"


def corrected(sequence: Sequence, assembly: Assembly, notes: Path) -> list[int]:
    """The frames whose lid was corrected."""
    with open_annotation(sequence, assembly, folder=notes) as store:
        return [frame for frame, _ in store.poses()]


def correct_lid(sequence: Sequence, assembly: Assembly, notes: Path) -> None:
    with open_annotation(sequence, assembly, folder=notes) as store:
        store.set_pose(0, "lid", np.eye(4))


@pytest.mark.parametrize("numbers", [[0], [3], [7], [0, 1, 2, 4, 5, 6, 7]])
@pytest.mark.parametrize("left", [0, 40])
def test_damaged_pictures_hide_no_corrections(
    tmp_path: Path, boxes: Assembly, numbers: list[int], left: int
) -> None:
    sequence, notes = capture(tmp_path / "one", boxes, light=10), tmp_path / "notes"
    correct_lid(sequence, boxes, notes)
    for number in numbers:
        file = Path(sequence.path) / "rgb" / f"{number:06d}.png"
        file.write_bytes(file.read_bytes()[:left])
    assert corrected(sequence, boxes, notes) == [0]
    assert names(notes) == ["take.db"]
    # Another capture of the name is another, damaged or not.
    other = capture(tmp_path / "other", boxes, light=90)
    (Path(other.path) / "rgb" / "000003.png").write_bytes(b"")
    assert corrected(other, boxes, notes) == []
    assert names(notes) == ["take-2.db", "take.db"]


def test_a_picture_that_is_whole_again_hides_no_corrections(
    tmp_path: Path, boxes: Assembly
) -> None:
    sequence, notes = capture(tmp_path / "one", boxes, light=10), tmp_path / "notes"
    file = Path(sequence.path) / "rgb" / "000003.png"
    whole = file.read_bytes()
    file.write_bytes(whole[:40])
    correct_lid(sequence, boxes, notes)
    for content in (whole, whole[:40], b"", whole):
        file.write_bytes(content)
        assert corrected(sequence, boxes, notes) == [0]
    assert names(notes) == ["take.db"]


def test_a_picture_that_the_disk_does_not_give_hides_no_corrections(
    tmp_path: Path, boxes: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence, notes = capture(tmp_path / "one", boxes, light=10), tmp_path / "notes"
    correct_lid(sequence, boxes, notes)
    read = Path.read_bytes

    def failing(path: Path) -> bytes:
        if path.name == "000003.png":
            raise OSError(5, "Input/output error")
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", failing)
    assert corrected(sequence, boxes, notes) == [0]


def test_a_file_from_before_pictures_were_noted_is_found(tmp_path: Path, boxes: Assembly) -> None:
    sequence, notes = capture(tmp_path / "one", boxes, light=10), tmp_path / "notes"
    images = sorted((Path(sequence.path) / "rgb").iterdir())
    named = b"".join(image.name.encode() + b"\0" + image.read_bytes() for image in images)
    identity = hashlib.sha256(named).hexdigest()
    assert sequence_identity(sequence) == identity
    file = notes / "take.db"
    with AnnotationStore(
        file, sequence_name="take", assembly_name="boxes", identity=identity
    ) as store:
        store.set_pose(0, "lid", np.eye(4))
    assert corrected(sequence, boxes, notes) == [0]
    images[2].write_bytes(b"")  # opened once, it is known by its pictures
    assert corrected(sequence, boxes, notes) == [0]


def test_a_sequences_very_own_file_goes_before_one_that_is_like_it(
    tmp_path: Path, boxes: Assembly
) -> None:
    """The first pictures of a capture alone, which once got a file of their own, keep it."""
    long, notes = capture(tmp_path / "one", boxes, light=10), tmp_path / "notes"
    correct_lid(long, boxes, notes)
    short = capture(tmp_path / "short", boxes, light=10)
    for number in range(3, 8):
        (Path(short.path) / "rgb" / f"{number:06d}.png").unlink()
    identity = sequence_identity(short)
    AnnotationStore(
        notes / "take-2.db", sequence_name="take", assembly_name="boxes", identity=identity
    ).close()
    assert own_annotation_file(short, folder=notes) == notes / "take-2.db"
    assert own_annotation_file(long, folder=notes) == notes / "take.db"
