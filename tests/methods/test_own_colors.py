"""A red part, known where it lay, and another thing of its shape elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.asdf_track import AsdfTrack
from asdfviz.methods.asdf_track_config import AsdfTrackConfig
from asdfviz.methods.own_colors import OwnColors, OwnColorsConfig

pytestmark = pytest.mark.usefixtures("shapes_unchecked")

HERE = transform_from(np.eye(3), np.array([-0.1, 0.0, 0.6]))
THERE = transform_from(np.eye(3), np.array([0.1, 0.0, 0.6]))
BASE = transform_from(np.eye(3), np.array([0.0, 0.12, 0.6]))
PART = "block"
HAND = 0.45
"""Depth of a hand, metres."""
RED, SHADED, DARK, WHITE = (190, 30, 30), (80, 14, 14), (22, 5, 5), (200, 200, 205)


def frame(toy, at: dict[str, tuple[Transform, tuple[int, int, int]]], index: int = 0) -> Frame:
    """Parts of some colours on a grey table, with the base."""
    rgb = np.full((*toy.depth({}).shape, 3), 110.0)
    for T, color in at.values():
        rgb[toy.depth({PART: T}) < 0.7] = color
    rgb[toy.depth({"base": BASE}) < 0.7] = (30, 60, 200)
    rgb += np.random.default_rng(index).normal(size=rgb.shape) * 3
    rgb = np.clip(rgb, 0, 255).astype(np.uint8)
    rgb[0, 0] = index  # what the fake detector reads
    depth = np.minimum.reduce([toy.depth({PART: T}) for T, _ in at.values()])
    depth = np.minimum(depth, toy.depth({"base": BASE}))
    return replace(toy.frame(index), rgb=rgb, depth=depth)


def behind_a_hand(shot: Frame, T: Transform, toy) -> Frame:
    """The frame with a hand on all that is around a part."""
    rgb, depth = shot.rgb.copy(), np.array(shot.depth)
    rows, columns = np.nonzero(toy.depth({PART: T}) < 0.7)
    here = np.s_[rows.min() - 8 : rows.max() + 8, columns.min() - 8 : columns.max() + 8]
    rgb[here], depth[here] = (200, 150, 130), HAND
    rgb[0, 0] = shot.rgb[0, 0]
    return replace(shot, rgb=rgb, depth=depth)


def others(
    toy,
    assembly: Assembly,
    color: tuple[int, int, int],
    *,
    at: Transform = THERE,
    config: OwnColorsConfig | None = None,
) -> frozenset[str]:
    """What is said of a thing of that colour, of a part that was red here."""
    own = OwnColors(assembly, config=config or OwnColorsConfig())
    assert own.others(frame(toy, {"thing": (at, color)}), {PART: at}, {PART: HERE}) == frozenset()
    own.see(frame(toy, {PART: (HERE, RED)}), {PART: HERE})
    return own.others(frame(toy, {"thing": (at, color)}), {PART: at}, {PART: HERE})


def test_a_white_thing_elsewhere_is_no_red_part(toy, assembly: Assembly) -> None:
    assert others(toy, assembly, WHITE) == {PART}
    assert others(toy, assembly, RED) == frozenset()
    assert others(toy, assembly, SHADED) == frozenset(), "shadow leaves the tint as it is"
    off = OwnColorsConfig(enabled=False)
    assert others(toy, assembly, WHITE, config=off) == frozenset()


def test_what_is_far_darker_elsewhere_is_no_red_part(toy, assembly: Assembly) -> None:
    """A glove of its tint, say; light and shadow do not reach as far."""
    assert others(toy, assembly, DARK) == {PART}
    assert others(toy, assembly, DARK, config=OwnColorsConfig(bright=2.0)) == frozenset()
    assert others(toy, assembly, DARK, at=HERE) == frozenset()


def test_what_stays_in_its_place_may_come_into_another_light(toy, assembly: Assembly) -> None:
    near = transform_from(np.eye(3), HERE[:3, 3] + 0.2 * assembly.parts[PART].diameter)
    assert others(toy, assembly, WHITE, at=near) == frozenset()


def test_tints_follow_slow_changes_alone(toy, assembly: Assembly) -> None:
    own = OwnColors(assembly, config=OwnColorsConfig())
    own.see(frame(toy, {PART: (HERE, RED)}), {PART: HERE})
    white = frame(toy, {PART: (HERE, WHITE), "other": (THERE, WHITE)})
    for _ in range(20):
        own.see(white, {PART: HERE})
    asked = white, {PART: THERE}, {PART: HERE}
    assert own.others(*asked) == {PART}, "what suddenly is white is not learnt"
    own.rename({PART: "pin", "pin": PART})
    assert own.others(*asked) == frozenset()
    own.rename({PART: "pin", "pin": PART})
    assert own.others(*asked) == {PART}
    own.forget(frozenset({PART}))
    assert own.others(*asked) == frozenset()
    fading = OwnColors(assembly, config=OwnColorsConfig())
    for share in np.linspace(0, 1, 30):
        color = tuple(int(c) for c in (1 - share) * np.array(RED) + share * np.array(WHITE))
        fading.see(frame(toy, {PART: (HERE, color)}), {PART: HERE})  # type: ignore[arg-type]
    assert fading.others(*asked) == frozenset()


def test_what_is_hidden_has_no_tint(toy, assembly: Assembly) -> None:
    own = OwnColors(assembly, config=OwnColorsConfig())
    own.see(frame(toy, {PART: (HERE, RED)}), {PART: HERE})
    hidden = behind_a_hand(frame(toy, {"other": (THERE, WHITE)}), THERE, toy)
    assert own.others(hidden, {PART: THERE}, {PART: HERE}) == frozenset()


@pytest.mark.usefixtures("small_models")
@pytest.mark.parametrize("color", [WHITE, RED])
def test_a_part_behind_a_hand_is_not_taken_for_a_thing_of_another_tint(
    toy, assembly: Assembly, detector, color: tuple[int, int, int]
) -> None:
    """The thing comes to lie there, and the detector finds it once it no longer finds the part."""
    method = AsdfTrack(AsdfTrackConfig(), detector=detector)
    part, thing = {PART: (HERE, RED)}, {"thing": (THERE, color)}
    shots = [frame(toy, part, i) for i in range(8)]
    both = (frame(toy, part | thing, i) for i in range(8, 14))
    shots += [behind_a_hand(shot, HERE, toy) for shot in both]
    method.reset(assembly, shots[0].camera, None)
    base, said = toy.detection("base", BASE), None
    for i, shot in enumerate(shots):
        detector.answers[i] = (base, toy.detection(PART, HERE if i < 8 else THERE))
        said = method.step(shot).poses.get(PART)
    jumped = said is not None and np.linalg.norm(said.T_camera_part[:3, 3] - THERE[:3, 3]) < 0.02
    assert jumped == (color == RED)


@pytest.mark.parametrize("wrong", [{"unlike": 0.0}, {"bright": 0.0}, {"rate": 0.0}, {"rate": 1.5}])
def test_options_out_of_range_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(MethodError, match="own_colors"):
        OwnColorsConfig(**wrong)  # type: ignore[arg-type]
