"""`asdfviz ablate`: wrong input, what it compares, and one whole table."""

from __future__ import annotations

import dataclasses
import json
import shutil
from pathlib import Path

import pytest
from exits import exit_code

from asdfviz.data.assembly import load_assembly
from asdfviz.data.resources import sample_folder
from asdfviz.methods.keypoint_variants import keypoint_variants
from asdfviz.methods.registry import find_method
from asdfviz.methods.variants import (
    beyond_variants,
    first_poses,
    group_variants,
    refinement_variants,
    state_variants,
    weighting_variants,
)

FRAMES = 3


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """The first frames of the sample."""
    sample, folder = sample_folder(), tmp_path / "short"
    for kind in ("rgb", "depth"):
        (folder / kind).mkdir(parents=True)
        for file in sorted((sample / kind).iterdir())[:FRAMES]:
            shutil.copy(file, folder / kind)
    for file in sample.glob("*.json"):
        content = json.loads(file.read_text())
        if isinstance(content, list):
            content = content[:FRAMES]
        elif set(content) >= {"0", "1"}:
            content = {key: content[key] for key in list(content)[:FRAMES]}
        (folder / file.name).write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--out", "table.pdf"), ".md, .csv or .tex"),
        (("--data", "nowhere"), "nowhere"),
        (("--data", "nowhere", "--out", "/dev/null/table.md"), "/dev/null is a file"),
        (("--pictures", "0"), "--pictures"),
    ],
)
def test_wrong_input_is_told(
    options: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert exit_code("ablate", "group", *options) == 2
    assert said in capsys.readouterr().err


def test_a_scene_without_truth_is_told_before_anything_runs(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("scene_gt.json", "states.json"):
        (scene / name).unlink()
    assert exit_code("ablate", "fusion", "--data", str(scene)) == 2
    assert "scene_gt.json" in capsys.readouterr().err


def test_every_variant_is_a_config_of_its_method() -> None:
    assembly = load_assembly("corner_clamp")
    for variant in (
        *refinement_variants(assembly),
        *group_variants(assembly),
        *state_variants(assembly),
        *weighting_variants(assembly),
    ):
        assert isinstance(variant.config, find_method(variant.method).config)
        assert variant.title.endswith(variant.config.first_pose)
    for variants in (refinement_variants(assembly), weighting_variants(assembly)):
        assert len({variant.title for variant in variants}) == len(variants)
    kinds = {v.config.translation.weights for v in weighting_variants(assembly)}
    assert kinds == {"gaussian", "huber", "cauchy", "nearest", "uniform"}
    papers = {v.paper for v in refinement_variants(assembly)}
    assert papers == {"none", "icp", "segmentation", "translation", ""}


def test_every_piece_made_of_keypoints_is_off_once() -> None:
    rows = keypoint_variants()
    configs = [row.config for row in rows]
    assert all(row.config.first_pose == "keypoints" for row in rows)
    for row in rows:
        assert isinstance(row.config, find_method(row.method).config)
        assert configs.count(row.config) == 1


def test_every_piece_beyond_the_paper_is_off_once(tmp_path: Path) -> None:
    assembly = load_assembly("corner_clamp")
    rows = beyond_variants(assembly)
    for variant in rows:
        assert isinstance(variant.config, find_method(variant.method).config)
    for row in rows:
        whole = next(r for r in rows if r.title == row.method)
        assert (row.config == whole.config) == (row is whole)
    without = dataclasses.replace(assembly, path=str(tmp_path / "a" / "assembly.yaml"))
    assert beyond_variants(without) == []


def test_hypotheses_are_compared_where_crop_weights_are(tmp_path: Path) -> None:
    assembly = load_assembly("corner_clamp")
    config = find_method("asdf").config()
    missing = dataclasses.replace(
        config, crops=dataclasses.replace(config.crops, weights=tmp_path / "none.safetensors")
    )
    assert first_poses(missing, assembly) == ["keypoints"]
    assert first_poses(object(), assembly) == []


def test_fusion_writes_a_table(scene: Path, tmp_path: Path) -> None:
    out = tmp_path / "fusion.csv"
    assert exit_code("ablate", "fusion", "--data", str(scene), "--out", str(out)) == 0
    lines = out.read_text().splitlines()
    assert lines[0].startswith("Variant,Scenes,state")
    assert any(line.startswith("best of 120") or "best of 120" in line for line in lines)
    assert sum("hidden Markov model" in line for line in lines) == 2
