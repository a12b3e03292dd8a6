"""Image folders: labels, masks, and folders that belong to something else."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.data.assembly_writer import write_assembly
from asdfviz.data.resources import way_to_assembly
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import KEYPOINTS, Assembly
from asdfviz.errors import InputError
from asdfviz.geometry.camera import project
from asdfviz.geometry.transforms import apply, transform_from
from asdfviz.synth.images import TEST_SEEDS, generate_images
from asdfviz.synth.packs import PackConfig
from asdfviz.synth.scene import SceneConfig

WIDTH, HEIGHT = 128, 80
SCENES = SceneConfig(width=WIDTH, height=HEIGHT, distractors=1)
PACKS = PackConfig(width=WIDTH, height=HEIGHT)
COUNT = 2


pytestmark = pytest.mark.usefixtures("toy_loaded_once")


@pytest.fixture(scope="module", params=["scenes", "packs"])
def folder(
    toy: Assembly, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    folder = tmp_path_factory.mktemp("images")
    config = SCENES if request.param == "scenes" else PACKS
    generate_images(toy, count=COUNT, seed=8, folder=folder, config=config, masks=True)
    return folder


def picture(path: Path) -> np.ndarray:
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert found is not None
    return found


def read(folder: Path, name: str) -> dict[str, Any]:
    return json.loads((folder / name).read_text())


def test_masks_agree_with_the_counts_of_the_truth(folder: Path) -> None:
    seen = 0
    for frame, entries in read(folder, "scene_gt_info.json").items():
        for k, info in enumerate(entries):
            name = f"{int(frame):06d}_{k:06d}.png"
            whole, visible = (picture(folder / room / name) > 0 for room in ("mask", "mask_visib"))
            assert whole.shape == (HEIGHT, WIDTH)
            assert int(visible.sum()) == info["px_count_visib"]
            assert not (visible & ~whole).any()
            x, y, w, h = (int(v) for v in info["bbox_obj"])
            if x >= 0 and y >= 0 and x + w <= WIDTH and y + h <= HEIGHT:
                assert abs(int(whole.sum()) - info["px_count_all"]) <= 1
                seen += 1
    assert seen > 0


def test_label_files_follow_the_format_and_the_truth(folder: Path, toy: Assembly) -> None:
    K = np.array(read(folder, "scene_camera.json")["0"]["cam_K"]).reshape(3, 3)
    truth = read(folder, "scene_gt.json")
    compared = 0
    for frame in range(COUNT):
        lines = (folder / "labels" / f"{frame:06d}.txt").read_text().splitlines()
        assert lines
        for line in lines:
            row = np.array(line.split(), float)
            assert len(row) == 5 + 3 * KEYPOINTS
            label, keypoints = int(row[0]), row[5:].reshape(KEYPOINTS, 3)
            assert (row[1:] >= 0).all()
            assert (row[1:5] <= 1).all()
            assert (keypoints[:, :2] <= 1).all()
            assert (keypoints[keypoints[:, 2] == 0] == 0).all()
            compared += _nearest_projection(
                keypoints, list(toy.parts)[label], toy, truth[str(frame)], K
            )
    assert compared >= COUNT


def _nearest_projection(
    keypoints: np.ndarray, part: str, toy: Assembly, entries: list[dict[str, Any]], K: np.ndarray
) -> bool:  # fmt: skip
    """Whether one of the true poses of the part puts its keypoints where the row says, to 0.7 px."""
    labelled = keypoints[:, 2] > 0
    pixels = keypoints[:, :2] * [WIDTH, HEIGHT] - 0.5
    for entry in entries:
        if entry["obj_id"] != part:
            continue
        T = transform_from(
            np.array(entry["cam_R_m2c"]).reshape(3, 3), np.array(entry["cam_t_m2c"]) / 1000
        )
        expected = project(apply(T, toy.parts[part].keypoints), K)
        if np.abs(expected - pixels)[labelled].max(initial=0) < 0.7:
            return True
    return False


def test_states_have_rows_without_keypoints(tmp_path: Path, toy: Assembly) -> None:
    states = tuple(replace(s, detector_class=s.name if s.index else None) for s in toy.states)
    classes = (*toy.parts, *(s.detector_class for s in states if s.detector_class))
    labelled = replace(toy, states=states, detector_classes=classes)
    generate_images(labelled, count=3, seed=1, folder=tmp_path, config=PACKS)
    rows = [
        np.array(line.split(), float)
        for file in (tmp_path / "labels").iterdir()
        for line in file.read_text().splitlines()
    ]
    of_states = [row for row in rows if row[0] >= len(toy.parts)]
    assert of_states
    for row in of_states:
        assert (row[5:] == 0).all()
        assert (row[3:5] > 0).all()


def test_a_folder_is_taken_up_only_by_the_same_line(tmp_path: Path, toy: Assembly) -> None:
    def again(*, seed: int = 2, count: int = 1, config: SceneConfig | PackConfig = SCENES,
              masks: bool = False, shift: bool = False) -> int:  # fmt: skip
        return generate_images(
            toy, count=count, seed=seed, folder=tmp_path, config=config, masks=masks, shift=shift
        )

    assert again() == 1
    before = (tmp_path / "rgb" / "000000.jpg").stat().st_mtime_ns
    assert again(count=2) == 2
    assert (tmp_path / "rgb" / "000000.jpg").stat().st_mtime_ns == before
    with pytest.raises(InputError, match="seed 2, not 3"):
        again(seed=3)
    with pytest.raises(InputError, match="kind scenes, not packs"):
        again(config=PACKS)
    with pytest.raises(InputError, match="masks False, not True"):
        again(masks=True)
    with pytest.raises(InputError, match="shift False, not True"):
        again(shift=True)
    with pytest.raises(InputError, match="config"):
        again(config=SceneConfig(width=192, height=HEIGHT, distractors=1))


def test_somebody_else_s_folder_stays_as_it_is(tmp_path: Path, toy: Assembly) -> None:
    photo = tmp_path / "rgb" / "000000.jpg"
    photo.parent.mkdir()
    photo.write_bytes(b"mine")
    with pytest.raises(InputError, match="holds something else \\(rgb\\)"):
        generate_images(toy, count=1, seed=1, folder=tmp_path, config=SCENES)
    assert [p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*")] == [
        "rgb",
        "rgb/000000.jpg",
    ]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"count": 0}, "count is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": TEST_SEEDS.start + 3}, "belongs to test sets"),
        ({"config": SceneConfig(width=32, height=96)}, "32x96"),
        ({"config": PackConfig(groups=1.2)}, "groups is 1.2, use 0 to 1"),
        ({"config": PackConfig(hand=float("nan"))}, "hand is nan, use 0 to 1"),
        ({"config": PackConfig(sizes_px=(90.0, 40.0))}, "sizes_px is 90 to 40"),
        ({"config": PackConfig(128, 72, (80.0, 90.0))}, "sizes_px begins at 80, use 4 to 72"),
        ({"config": PackConfig(coverage=0.0)}, "coverage is 0, use more than 0"),
    ],
)
def test_impossible_jobs_are_refused_before_anything_is_written(
    tmp_path: Path, toy: Assembly, options: dict[str, int], said: str
) -> None:
    job = {"count": 1, "seed": 1, "config": SCENES, **options}
    with pytest.raises(InputError, match=said):
        generate_images(toy, folder=tmp_path / "new", **job)  # pyright: ignore[reportArgumentType]
    assert not (tmp_path / "new").exists()


def test_shifted_depth_is_moved_against_colour(tmp_path: Path, toy: Assembly) -> None:
    for name, shift in (("straight", False), ("shifted", True)):
        generate_images(toy, count=1, seed=4, folder=tmp_path / name, config=SCENES, shift=shift)
    colors, depths = (
        [picture(tmp_path / name / file) for name in ("straight", "shifted")]
        for file in ("rgb/000000.jpg", "depth/000000.png")
    )
    assert np.array_equal(colors[0], colors[1])
    assert not np.array_equal(depths[0], depths[1])


def test_what_is_drawn_of_an_assembly_of_ones_own_finds_it_again(
    toy: Assembly, tmp_path: Path
) -> None:
    write_assembly(toy, tmp_path / "here" / "my_toy")
    mine = load_assembly(tmp_path / "here" / "my_toy")
    folder = tmp_path / "here" / "data" / "train"
    generate_images(mine, count=1, seed=8, folder=folder, config=SCENES)
    found = open_sequence(folder).assembly
    assert found is not None
    assert Path(found.path) == Path(mine.path)
    # Together they may move, and the job goes on.
    (tmp_path / "here").rename(tmp_path / "there")
    moved = load_assembly(tmp_path / "there" / "my_toy")
    folder = tmp_path / "there" / "data" / "train"
    assert generate_images(moved, count=2, seed=8, folder=folder, config=SCENES) == 2
    found = open_sequence(folder).assembly
    assert found is not None
    assert Path(found.path) == Path(moved.path)
    (tmp_path / "there" / "my_toy").rename(tmp_path / "elsewhere")
    assert open_sequence(folder).missing_assembly == "toy"


def test_what_is_drawn_of_a_bundled_assembly_names_it_alone(folder: Path) -> None:
    assert read(folder, "sequence.json")["assembly"] == "toy"
    assert way_to_assembly(load_assembly("vise"), folder) == {}
    assert "assembly_path" not in read(folder, "sequence.json")  # the toy lies in no file
