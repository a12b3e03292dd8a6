from __future__ import annotations

import itertools
import json
from pathlib import Path
from types import SimpleNamespace

import pytest

from asdfviz.bench import track
from asdfviz.bench.track import (
    JSON_KEYS,
    ModeResult,
    bench_table,
    json_report,
    measure,
    read_recording,
)
from asdfviz.errors import SequenceError
from asdfviz.track.viewpoint_model import ViewpointConfig

PREFIX = 60
COARSE = ViewpointConfig(subdivisions=1, points=200, image_size=300)


def linked(shared: Path, folder: Path, *, frames: int, without: tuple[str, ...] = ()) -> Path:
    """The reference recording's first frames (60 are all), as a folder of links."""
    source = shared / "reference" / "tracker_jaw640"
    for item in source.iterdir():
        if item.name != "meta.json" and not item.name.startswith(without or ("-",)):
            (folder / item.name).symlink_to(item)
    meta = json.loads((source / "meta.json").read_text())
    (folder / "meta.json").write_text(json.dumps({**meta, "n": frames}))
    return folder


@pytest.fixture(scope="module")
def results(shared: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, ModeResult]:
    folder = linked(shared, tmp_path_factory.mktemp("recording"), frames=PREFIX)
    return measure(folder, runs=1)


def test_every_mode_is_as_near_as_m3t(results: dict[str, ModeResult]) -> None:
    for mode, row in results.items():
        assert row.m3t_add_mm_median is not None
        assert row.m3t_add_mm_max is not None
        assert row.add_mm_median <= 1.2 * row.m3t_add_mm_median, mode
        assert row.add_mm_max <= 1.2 * row.m3t_add_mm_max, mode


def test_a_perturbed_start_is_forgotten(results: dict[str, ModeResult]) -> None:
    for row in results.values():
        assert row.perturbed_add_mm_median is not None
        assert row.settled_add_mm_median is not None
        assert row.perturbed_add_mm_median <= 1.5 * row.settled_add_mm_median


def test_times_are_milliseconds_of_tracking(
    results: dict[str, ModeResult],
    shared: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a clock on which every frame takes 2 ms: a real one depends on what else the machine does."""
    assert all(row.m3t_ms_median is not None for row in results.values())
    assert all(row.ms_median > 0.01 for row in results.values())
    ticks = (0.002 * k for k in itertools.count())
    monkeypatch.setattr(track, "time", SimpleNamespace(perf_counter=lambda: next(ticks)))
    timed = measure(linked(shared, tmp_path, frames=3), runs=1, views=COARSE)
    assert [row.ms_median for row in timed.values()] == pytest.approx([2.0] * 3)


def test_the_report_has_exactly_its_keys(results: dict[str, ModeResult]) -> None:
    report = json_report(results)
    assert list(report) == ["region", "depth", "icg"]
    assert all(tuple(row) == JSON_KEYS for row in report.values())
    assert json.loads(json.dumps(report)) == report
    table = bench_table(results)
    assert "load of the machine" in table
    assert "first_frame_truth" in table
    assert table.count("M3T") == 3


def test_a_folder_without_references_gives_none(shared: Path, tmp_path: Path) -> None:
    folder = linked(shared, tmp_path, frames=3, without=("m3t_", "init_pert"))
    report = json_report(measure(folder, runs=1, views=COARSE))
    assert report["icg"]["m3t_add_mm_median"] is None
    assert report["icg"]["m3t_ms_median"] is None
    assert report["icg"]["add_mm_max"] is not None


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("meta.json", "{}", "meta.json"),
        ("meta.json", "no json", "meta.json"),
        ("gt.txt", "1 2 3", "gt.txt holds no 4x4 poses"),
        ("gt.txt", "", "meta.json says 2 frames, gt.txt has 0"),
        ("init.txt", None, "init.txt"),
        ("color", None, "0000.png is missing"),
    ],
)
def test_a_wrong_folder_is_named(
    shared: Path, tmp_path: Path, name: str, content: str | None, message: str
) -> None:
    folder = linked(shared, tmp_path, frames=2)
    (folder / name).unlink()
    if content is not None:
        (folder / name).write_text(content)
    with pytest.raises(SequenceError, match=message):
        read_recording(folder)
