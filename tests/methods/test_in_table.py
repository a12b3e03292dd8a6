"""A block of the toy in the table 0.75 m away, on it, past its edge, and beside what says nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Frame, PoseEstimate, Stage
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.asdf_plus import AsdfPlus
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.asdf_track import AsdfTrack
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.in_table import InTableConfig, in_table
from asdfviz.methods.part_poses import part_shapes

BASE = transform_from(np.eye(3), np.array([0.03, 0.02, 0.74]))


def at(z: float, x: float = -0.12) -> np.ndarray:
    return transform_from(np.eye(3), np.array([x, -0.06, z]))


def judged(
    toy,
    frame: Frame,
    T: np.ndarray,
    *,
    name: str = "block",
    score: float = 0.5,
    stage: Stage = "refined",
    config: InTableConfig | None = None,
) -> bool:
    shapes = part_shapes(toy.assembly, surface_points=1500)
    poses = {name: PoseEstimate(name, T, score, stage)}
    found = in_table(poses, shapes, frame, base="base", config=config or InTableConfig())
    return found == {name}


def test_a_part_with_most_of_it_under_the_bare_table_is_in_it(toy) -> None:
    frame = toy.frame(0, {"base": BASE})
    assert judged(toy, frame, at(0.765))
    assert not judged(toy, frame, at(0.735))
    assert not judged(toy, frame, at(0.6))


def test_what_is_sure_or_held_and_the_base_are_left_to_others(toy) -> None:
    frame, deep = toy.frame(0, {"base": BASE}), at(0.765)
    assert not judged(toy, frame, deep, score=0.9)
    assert judged(toy, frame, deep, score=0.9, config=InTableConfig(sure=0.95))
    assert not judged(toy, frame, deep, stage="group")
    assert judged(toy, frame, deep, stage="tracked")
    assert not judged(toy, frame, deep, name="base")
    assert not judged(toy, frame, deep, config=InTableConfig(enabled=False))


def test_an_arm_over_it_is_no_table(toy) -> None:
    frame = toy.frame(0, {"base": BASE})
    assert frame.depth is not None
    frame.depth[:80] = 0.5  # and what is between that and the table is in nothing
    assert judged(toy, frame, at(0.765))
    assert not judged(toy, frame, at(0.65))
    frame.depth[:200] = 0.5  # now the largest plane of the picture
    assert not judged(toy, frame, at(0.735))


def test_nothing_is_in_a_table_that_is_not_seen_there(toy) -> None:
    deep = at(0.765)
    frame = toy.frame(0, {"base": BASE})
    assert frame.depth is not None
    past = replace(frame, depth=frame.depth.copy())
    assert past.depth is not None
    past.depth[:, :110] = 0.85  # one looks down beside it
    assert not judged(toy, past, deep)
    blind = replace(frame, depth=frame.depth.copy())
    assert blind.depth is not None
    blind.depth[:, :110] = 0.0
    assert not judged(toy, blind, deep)
    assert not judged(toy, toy.frame(0), deep)
    assert not judged(toy, frame, at(0.765, x=-3.0))


@pytest.mark.parametrize(
    ("deep", "share", "sure"), [(-1.0, 0.5, 0.8), (0.0, 1.5, 0.8), (0.0, 0.5, np.nan)]
)
def test_options_out_of_their_range_are_refused(deep: float, share: float, sure: float) -> None:
    with pytest.raises(MethodError, match="in_table"):
        InTableConfig(deep=deep, share=share, sure=sure)


def last(method, toy, detector) -> dict[str, PoseEstimate]:
    """What is told after some frames in which a block stands in the table."""
    method.reset(toy.assembly, toy.frame(0).camera, None)
    told, there = dict[str, PoseEstimate](), {"base": BASE, "block": at(0.762)}
    for index in range(6):
        frame = toy.frame(index, there)
        is_base, is_block = (
            toy.depth({"base": BASE}) < 0.745,
            toy.depth({"block": at(0.762)}) < 0.745,
        )
        rgb = np.where(is_base[:, :, None], (30, 60, 200), (110, 115, 120))
        rgb = np.where(is_block[:, :, None], (220, 120, 20), rgb)
        rgb = rgb + np.random.default_rng(index).normal(size=rgb.shape) * 3
        rgb[0, 0] = index  # what the fake detector reads
        frame = replace(frame, rgb=np.clip(rgb, 0, 255).astype(np.uint8))
        detector.answers[index] = tuple(toy.detection(name, T) for name, T in there.items())
        told = dict(method.step(frame).poses)
    return told


@pytest.mark.parametrize("sure", [1.0, 0.0])
@pytest.mark.parametrize("tracked", [True, False])
@pytest.mark.usefixtures("small_models", "shapes_unchecked")
def test_methods_do_not_tell_what_is_in_the_table_unless_they_are_sure(
    toy, detector, *, tracked: bool, sure: float
) -> None:
    rule = InTableConfig(sure=sure)
    if tracked:
        method = AsdfTrack(AsdfTrackConfig(in_table=rule), detector=detector)
    else:
        method = AsdfPlus(AsdfPlusConfig(in_table=rule, least_score=0.0), detector=detector)
    told = last(method, toy, detector)
    assert set(told) == ({"base"} if sure == 1.0 else {"base", "block"})


@pytest.mark.parametrize(
    ("enabled", "held", "goes_back"),
    [(True, False, True), (True, True, False), (False, False, False)],
)
@pytest.mark.usefixtures("small_models", "shapes_unchecked")
def test_what_the_tracker_moves_into_the_table_goes_back(
    toy, detector, *, enabled: bool, held: bool, goes_back: bool
) -> None:
    config = AsdfTrackConfig(in_table=InTableConfig(enabled=enabled))
    method = AsdfTrack(config, detector=detector)
    method.reset(toy.assembly, toy.frame(0).camera, None)
    there, frame = {"base": BASE, "block": at(0.73)}, toy.frame(0, {"base": BASE})
    detector.answers[0] = tuple(toy.detection(name, T) for name, T in there.items())
    method.step(frame)
    scene = method._scene
    assert scene is not None
    parts = scene.parts
    before = parts.tracks["block"].T_now
    parts.tracker.replace(frame, {"block": at(0.765)})
    method._lift(frame, frozenset({"block"} if held else ()), scene)
    np.testing.assert_allclose(
        parts.tracker.poses["block"], before if goes_back else at(0.765), atol=1e-9
    )
