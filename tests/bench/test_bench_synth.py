from __future__ import annotations

import pytest

from asdfviz.bench.synth import measure_synth, speed_table
from asdfviz.data.assembly import load_assembly
from asdfviz.errors import InputError


@pytest.mark.usefixtures("shapes_unchecked")
def test_every_kind_is_timed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asdfviz.bench.synth.SIZES", ((96, 64),))
    told: list[tuple[int, int]] = []
    speeds = measure_synth(
        load_assembly("corner_clamp"),
        images=1,
        progress=lambda done, total: told.append((done, total)),
    )
    assert told == [(1, 2), (2, 2)]
    assert [(s.kind, s.width, s.height, s.workers) for s in speeds] == [
        ("scene", 96, 64, 1),
        ("pack", 96, 64, 1),
    ]
    scenes, packs = speeds
    assert scenes.images_per_s > 0
    assert scenes.objects_per_s is None
    assert packs.objects_per_s is not None
    # Packs hold many.
    assert packs.objects_per_s >= 3 * packs.images_per_s
    assert [line.split()[:3] for line in speed_table(speeds).splitlines()[1:]] == [
        ["scene", "96x64", "1"],
        ["pack", "96x64", "1"],
    ]


def test_no_workers_are_refused() -> None:
    with pytest.raises(InputError, match="0 workers"):
        measure_synth(load_assembly("corner_clamp"), images=1, workers=0)


@pytest.mark.parametrize("images", [0, -1])
def test_no_images_are_refused(images: int) -> None:
    with pytest.raises(InputError, match=f"^{images} images: time 1 or more"):
        measure_synth(load_assembly("corner_clamp"), images=images)
