from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asdfviz.bench.track_parts import PartsResult, measure_parts, parts_table
from asdfviz.data.assembly import load_assembly
from asdfviz.errors import InputError
from asdfviz.track.presets import PRESETS

PARTS = 5


@pytest.fixture(scope="module")
def results() -> dict[str, PartsResult]:
    """More parts than the assembly has, so that some are there twice."""
    return measure_parts(
        load_assembly("corner_clamp"), parts=PARTS, frames=4, runs=1, size=(640, 360)
    )


def test_every_preset_follows_all_parts(results: dict[str, PartsResult]) -> None:
    assert list(results) == list(PRESETS)
    for name, row in results.items():
        assert row.parts == PARTS
        assert row.add_mm_median < 5.0, name
        assert row.add_mm_median <= row.add_mm_max
        assert row.cpu_ms_median > 0
        assert 0 < row.ms_median <= row.ms_p90


def test_the_table_names_every_preset_and_the_aim(results: dict[str, PartsResult]) -> None:
    table = parts_table(results)
    assert table.startswith(f"{PARTS} parts at")
    assert all(any(line.startswith(name) for line in table.splitlines()) for name in PRESETS)
    assert "20 ms for ten parts" in table


@pytest.mark.parametrize(
    ("folder", "parts", "message"),
    [
        (None, None, "either a folder or --parts"),
        (Path("x"), 10, "either a folder or --parts"),
        (None, 0, "--parts is 0"),
    ],
)
def test_the_command_wants_one_of_both(
    folder: Path | None, parts: int | None, message: str
) -> None:
    from asdfviz.cli.bench import BenchTrack

    with pytest.raises(InputError, match=message):
        BenchTrack(folder, parts)()


def test_all_parts_stay_in_the_picture() -> None:
    from asdfviz.bench import track_parts

    assembly = load_assembly("corner_clamp")
    models = track_parts.load_viewpoint_models(assembly)
    known = {n: track_parts.Body.of(p, models[n]) for n, p in assembly.parts.items()}
    bodies = track_parts._bodies(assembly, known, 10)
    assert len({tuple(b.color) for b in bodies.values()}) == 10
    for k in range(0, 30, 5):
        for name, T in track_parts._poses(bodies, k).items():
            centre = T[:3, :3] @ bodies[name].model.centre + T[:3, 3]
            u, v = track_parts.FOCAL * centre[:2] / centre[2]
            assert np.abs([2 * u, 2 * v]).max() < 1280
            assert abs(2 * v) < 720
