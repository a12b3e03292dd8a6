from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from asdfviz.data.kept_arrays import user_cache_folder
from asdfviz.datatypes import Assembly, Mesh, Part, State
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.track import viewpoint_cache
from asdfviz.track.viewpoint_cache import (
    FOLDER,
    load_viewpoint_models,
    pack_viewpoint_model,
    read_viewpoint_model,
    unpack_viewpoint_model,
)
from asdfviz.track.viewpoint_model import EDGE_COLUMN, ViewpointConfig, ViewpointModel

TINY = ViewpointConfig(subdivisions=0, points=20, image_size=100)


@pytest.fixture
def assembly(tmp_path: Path, box: Mesh, monkeypatch: pytest.MonkeyPatch) -> Assembly:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    part = Part(
        name="a",
        mesh=box,
        keypoints=np.zeros((17, 3)),
        symmetries=Symmetries(),
        diameter=0.12,
        color=np.zeros(3, np.uint8),
        detector_class="a",
    )
    parts = {"a": part, "twin": replace(part, name="twin")}
    states = (State(0, "empty", {"a": np.eye(4)}),)
    path = str(tmp_path / "assembly" / "assembly.yaml")
    return Assembly("x", "X", "a", parts, states, frozenset(), ("a",), path)


def test_a_model_is_made_once_and_twins_share_it(assembly: Assembly) -> None:
    told: list[tuple[int, int]] = []

    def progress(done: int, all_: int) -> None:
        told.append((done, all_))

    first = load_viewpoint_models(assembly, config=TINY, progress=progress)
    assert told == [(k, 12) for k in range(1, 13)]
    assert first["a"] is first["twin"]
    files = list((Path(assembly.path).parent / FOLDER).iterdir())
    assert len(files) == 1
    second = load_viewpoint_models(assembly, config=TINY, progress=progress)
    assert len(told) == 12
    # To the last bit: the run that makes the views finds what every later one finds.
    for field in fields(ViewpointModel):
        made, read = getattr(first["a"], field.name), getattr(second["a"], field.name)
        np.testing.assert_array_equal(made, read, err_msg=field.name)
        assert np.asarray(made).dtype == np.asarray(read).dtype


def test_what_changes_the_model_changes_its_name(assembly: Assembly, box: Mesh) -> None:
    load_viewpoint_models(assembly, config=TINY)
    load_viewpoint_models(assembly, config=replace(TINY, points=21))
    larger = replace(assembly.parts["a"], mesh=Mesh(box.vertices * 1.01, box.faces))
    load_viewpoint_models(replace(assembly, parts={"a": larger}), config=TINY)
    assert len(list((Path(assembly.path).parent / FOLDER).iterdir())) == 3


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04 broken"])
def test_a_broken_file_is_made_anew(assembly: Assembly, content: bytes) -> None:
    load_viewpoint_models(assembly, config=TINY)
    (file,) = (Path(assembly.path).parent / FOLDER).iterdir()
    file.write_bytes(content)
    assert read_viewpoint_model(file) is None
    load_viewpoint_models(assembly, config=TINY)
    assert read_viewpoint_model(file) is not None


def test_the_users_folder_serves_where_the_assembly_cannot_be_written(
    assembly: Assembly, monkeypatch: pytest.MonkeyPatch
) -> None:
    real: Callable[..., None] = viewpoint_cache.write_bytes

    def refuse(path: Path, data: bytes) -> None:
        if FOLDER in path.parts:
            raise PermissionError(path)
        real(path, data)

    monkeypatch.setattr(viewpoint_cache, "write_bytes", refuse)
    load_viewpoint_models(assembly, config=TINY)
    assert not (Path(assembly.path).parent / FOLDER).exists()
    assert len(list(user_cache_folder("viewpoints").iterdir())) == 1
    told: list[int] = []
    load_viewpoint_models(assembly, config=TINY, progress=lambda k, _: told.append(k))
    assert told == []


def test_a_file_keeps_micrometres_and_rounds_offsets_up(box_model: ViewpointModel) -> None:
    packed = pack_viewpoint_model(box_model)
    back = unpack_viewpoint_model(packed)
    np.testing.assert_allclose(back.contours[..., :3], box_model.contours[..., :3], atol=3e-6)
    normals = box_model.surfaces[..., 3:6]
    np.testing.assert_allclose(back.surfaces[..., 3:6], normals, atol=5e-5)
    edges = box_model.surfaces[..., EDGE_COLUMN]
    np.testing.assert_allclose(back.surfaces[..., EDGE_COLUMN], edges, rtol=1e-3, atol=1e-6)
    extra = back.surface_offsets - box_model.surface_offsets
    assert extra.min() > -1e-6
    assert extra.max() < 6e-4
    near = box_model.contours[..., 6]
    np.testing.assert_allclose(back.contours[..., 6], near, rtol=1e-3, atol=1e-6)
    # No background met: still far beyond every line.
    assert back.contours[..., 7].min() > 1.0
    assert len(packed) < 162 * 200 * 30
