from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Frame, Mesh, PoseEstimate
from asdfviz.geometry.camera import project
from asdfviz.geometry.shapes import Scores
from asdfviz.geometry.transforms import apply, rotation_about, transform_from
from asdfviz.methods.drawn_smear import Smear
from asdfviz.methods.group_fits import LONG, GroupFits
from asdfviz.methods.group_trials import Trial
from asdfviz.methods.group_views import measured_in, view_of
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.seen_smear import SeenSmear, SmearConfig
from asdfviz.state.colors import Look
from asdfviz.state.group_fit import GroupFitConfig, Move
from asdfviz.state.joint_places import JointPlaces

KNOWN = np.array([0.99, 0.01])
RED, GREEN = (220, 50, 40), (30, 200, 60)


def fits_of(assembly: Assembly, **options) -> GroupFits:
    shapes = part_shapes(assembly, surface_points=900)
    return GroupFits(assembly, shapes, config=GroupFitConfig(**options))


def found(T_camera_base: np.ndarray, *, score: float = 0.9) -> dict[str, PoseEstimate]:
    return {"base": PoseEstimate("base", T_camera_base, score, "refined")}


def painted(toy, block: np.ndarray, color: tuple[int, int, int]) -> Frame:
    """The base in blue, and a block of some colour at this pose."""
    apart = toy.poses(joined=False)
    frame = toy.frame(1, {"base": apart["base"], "block": block})
    rgb = np.full((*frame.rgb.shape[:2], 3), (90, 140, 90), np.uint8)
    base, front = toy.depth({"base": apart["base"]}), toy.depth({"block": block})
    rgb[base < 0.74] = (40, 60, 200)
    rgb[front < np.minimum(base, 0.74)] = color
    return replace(frame, rgb=rgb)


def after_a_red_block_apart(toy, assembly: Assembly, color: tuple[int, int, int]) -> Scores | None:
    """What is said of a thing of this colour in the block's place, once a red block lay apart for three frames."""
    apart, joined = toy.poses(joined=False), toy.poses(joined=True)
    fits, poses = fits_of(assembly), found(apart["base"])
    poses["block"] = PoseEstimate("block", apart["block"], 0.9, "refined")
    for _ in range(3):
        fits.step(poses, KNOWN, painted(toy, apart["block"], RED))
    return fits.step(found(joined["base"]), KNOWN, painted(toy, joined["block"], color))


def noisy(frame: Frame, seed: int = 0) -> Frame:
    """Depth as cameras give it: 3 mm of noise, and holes."""
    assert frame.depth is not None
    rng = np.random.default_rng(seed)
    depth = frame.depth + 0.003 * rng.normal(size=frame.depth.shape)
    depth[rng.random(depth.shape) < 0.1] = 0.0
    return replace(frame, depth=depth.astype(np.float32))


@pytest.mark.parametrize("joined", [False, True])
def test_the_state_is_seen_though_the_block_is_not_detected(toy, joined: bool) -> None:
    true = toy.poses(joined=joined)
    said = fits_of(toy.assembly).step(found(true["base"]), KNOWN, noisy(toy.frame(1, true)))
    assert said is not None
    assert said[int(joined)] > 0.95


def test_a_base_whose_origin_lies_elsewhere_tells_as_much(toy) -> None:
    """Next to the camera: at its origin's depth, cells are so small that they would tell little."""
    true = toy.poses(joined=True)
    away = true["base"][:3, :3].T @ np.array([0.0, 0.0, -0.5])
    mesh, state = toy.assembly.parts["base"].mesh, toy.assembly.states[1]
    base = replace(toy.assembly.parts["base"], mesh=Mesh(mesh.vertices - away, mesh.faces))
    shift = transform_from(np.eye(3), -away)
    joined = replace(
        state, T_base_part={"base": np.eye(4), "block": shift @ state.T_base_part["block"]}
    )
    moved = replace(
        toy.assembly,
        parts={**toy.assembly.parts, "base": base},
        states=(toy.assembly.states[0], joined),
    )
    T_moved = true["base"] @ transform_from(np.eye(3), away)
    said = [
        fits_of(assembly).step(found(T), KNOWN, toy.frame(1, true))
        for assembly, T in ((toy.assembly, true["base"]), (moved, T_moved))
    ]
    assert said[0] is not None
    assert said[1] == pytest.approx(said[0], abs=0.02)


def test_a_part_that_one_sees_through_is_not_there(toy) -> None:
    """The block's own pose lies: it is where the state has it, but depth shows the base."""
    apart, joined = toy.poses(joined=False), toy.poses(joined=True)
    poses = found(apart["base"])
    poses["block"] = PoseEstimate("block", joined["block"], 0.9, "refined")
    said = fits_of(toy.assembly).step(poses, KNOWN, toy.frame(1, {"base": apart["base"]}))
    assert said is not None
    assert said[0] > 0.95


def test_under_a_hand_nothing_is_said(toy) -> None:
    true = toy.poses(joined=True)
    frame = toy.frame(1, true)
    covered = replace(frame, depth=np.full_like(frame.depth, 0.3))
    fits = fits_of(toy.assembly)
    assert fits.step(found(true["base"]), KNOWN, covered) is None
    assert fits.base is None


def test_a_base_that_is_not_where_its_pose_says_decides_nothing(toy) -> None:
    """Thirty centimetres off there is only ground."""
    true = toy.poses(joined=True)
    off = transform_from(np.eye(3), np.array([-0.1, 0.05, -0.1])) @ true["base"]
    assert fits_of(toy.assembly).step(found(off), KNOWN, toy.frame(1, true)) is None


@pytest.mark.parametrize(("score", "is_taken"), [(0.9, True), (0.3, False)])
def test_a_base_is_not_remembered_where_another_part_surely_lies(
    toy, score: float, is_taken: bool
) -> None:
    true = toy.poses(joined=False)
    fits, frame = fits_of(toy.assembly), toy.frame(1, {"base": true["base"]})
    assert fits.step(found(true["base"]), KNOWN, frame) is not None
    pin = {"pin": PoseEstimate("pin", true["base"], score, "refined")}
    assert (fits.step(pin, KNOWN, frame) is None) == is_taken


def test_a_poor_pose_of_the_base_is_mended_by_the_group(toy) -> None:
    true = toy.poses(joined=True)
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), 0.12)
    middle = true["base"][:3, 3]
    off = transform_from(turn, middle - turn @ middle + np.array([0.012, -0.008, 0.0]))
    fits = fits_of(toy.assembly)
    said = fits.step(found(off @ true["base"]), np.array([0.02, 0.98]), toy.frame(1, true))
    assert said is not None
    assert said[1] > 0.95
    assert fits.base is not None
    left = np.linalg.norm(fits.base.T_camera_part[:3, 3] - true["base"][:3, 3])
    assert left < 0.006


@pytest.mark.parametrize("joined", [False, True])
@pytest.mark.parametrize("nearer", [-0.005, 0.005])
def test_a_state_is_known_though_the_base_was_put_too_near_or_too_far(
    toy, joined: bool, nearer: float
) -> None:
    """A pose that depth refined on the block's top is that much too near."""
    true = toy.poses(joined=joined)
    off = true["base"].copy()
    off[:3, 3] *= 1 - nearer / off[2, 3]
    said = fits_of(toy.assembly).step(found(off), KNOWN, toy.frame(1, true))
    assert said is not None
    assert said[int(joined)] > 0.95


def test_a_base_pose_that_agrees_well_enough_gives_way_to_where_it_was_if_that_fits_better(
    toy,
) -> None:
    """It may be off by little, and the block on the base then seems not to be there."""
    true = toy.poses(joined=True)
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), 0.1)
    middle = true["base"][:3, 3]
    off = transform_from(turn, middle - turn @ middle + np.array([0.004, 0.004, 0.0]))
    fits, belief = fits_of(toy.assembly, enough=0.5), np.array([0.02, 0.98])
    assert fits.step(found(true["base"]), belief, toy.frame(1, true)) is not None
    assert fits.step(found(off @ true["base"]), belief, toy.frame(1, true)) is not None
    assert fits.base is not None
    np.testing.assert_allclose(fits.base.T_camera_part, true["base"], atol=1e-9)


def test_every_scene_lies_as_near_as_its_own_surface_is_measured(toy) -> None:
    """By the base alone it would be nearer where a flat block covers most of the base."""
    shapes = part_shapes(toy.assembly, surface_points=900)
    true, config = toy.poses(joined=True), GroupFitConfig()
    frame = toy.frame(1, true)
    assert frame.depth is not None
    corners = np.concatenate([apply(T, shapes[n].corners) for n, T in true.items()])
    view = view_of(project(corners, frame.camera.K), frame, frame.depth, cells=50)
    assert view is not None
    blank = np.zeros(view.depth.shape, np.float32)
    looks = [None] * len(toy.assembly.parts)
    measured = measured_in(view, blank, looks, black=[False] * len(looks), base=0, config=config)
    places = JointPlaces(toy.assembly)
    trial = Trial(toy.assembly, true["base"], places, view, measured, config)
    for state in toy.assembly.states:
        assert trial.nearer(state) == pytest.approx(0.0, abs=1e-3)
    near = true["base"].copy()
    near[:3, 3] *= 1 - 0.005 / near[2, 3]
    trial = Trial(toy.assembly, near, places, view, measured, config)
    assert trial.nearer(toy.assembly.states[1]) == pytest.approx(-0.005, abs=1e-3)
    moved = trial.moved(Move(), toy.assembly.states[1]).T_camera_base
    np.testing.assert_allclose(moved[:3, 3], true["base"][:3, 3], atol=1e-3)


def test_the_base_is_looked_for_where_its_group_was_settled(toy) -> None:
    true = toy.poses(joined=True)
    wrong = true["base"].copy()
    wrong[:3, 3] += [0.014, -0.012, 0.0]
    errors = []
    for settled in (False, True):
        fits = fits_of(toy.assembly, reach=0, shift=0, least_agreeing=0.0)
        fits.settle(true["base"])  # nothing was said yet: nothing to settle
        assert fits.step(found(wrong), np.array([0.02, 0.98]), toy.frame(1, true)) is not None
        if settled:
            fits.settle(true["base"])
        assert fits.step({}, np.array([0.02, 0.98]), toy.frame(2, true)) is not None
        assert fits.base is not None
        T = fits.base.T_camera_part
        errors.append(np.linalg.norm(T[:3, 3] - true["base"][:3, 3]))
    assert errors[0] > 0.01
    assert errors[1] < 1e-6


def test_a_base_that_was_lost_is_where_it_was(toy) -> None:
    true = toy.poses(joined=True)
    fits = fits_of(toy.assembly)
    assert fits.step(found(true["base"]), KNOWN, toy.frame(1, true)) is not None
    said = fits.step({}, KNOWN, toy.frame(2, true))
    assert said is not None
    assert said[1] > 0.95


@pytest.mark.parametrize(("frames", "is_known"), [(LONG + 1, True), (2, False)])
def test_one_frame_that_takes_another_part_for_the_base_is_forgotten(
    toy, frames: int, is_known: bool
) -> None:
    """Where it was for long it is asked for again once it is seen no more where it was said to be."""
    true, fits = toy.poses(joined=True), fits_of(toy.assembly)
    for _ in range(frames):
        assert fits.step(found(true["base"]), KNOWN, toy.frame(1, true)) is not None
    elsewhere = transform_from(np.eye(3), np.array([0.1, 0.06, 0.0])) @ true["base"]
    shown = toy.frame(2, {"base": elsewhere})
    assert fits.step(found(elsewhere), KNOWN, shown) is not None
    assert (fits.step({}, KNOWN, toy.frame(3, true)) is not None) == is_known
    if is_known:
        assert fits.base is not None
        assert np.allclose(fits.base.T_camera_part, true["base"], atol=0.004)


def test_a_base_that_was_never_found_is_where_a_sure_part_says(toy) -> None:
    true = toy.poses(joined=True)
    joined, fits = np.array([0.01, 0.99]), fits_of(toy.assembly)
    unsure = {"block": PoseEstimate("block", true["block"], 0.5, "refined")}
    assert fits.step(unsure, joined, noisy(toy.frame(1, true))) is None
    sure = {"block": replace(unsure["block"], score=0.9)}
    said = fits.step(sure, joined, noisy(toy.frame(2, true)))
    assert said is not None
    assert said[1] > 0.95
    assert fits.base is not None
    assert np.allclose(fits.base.T_camera_part, true["base"], atol=0.004)
    # A block that lies by itself is not on a base.
    apart = toy.poses(joined=False)
    alone = {"block": PoseEstimate("block", apart["block"], 0.9, "refined")}
    assert fits_of(toy.assembly).step(alone, joined, noisy(toy.frame(1, apart))) is None


def test_another_thing_in_the_place_of_the_block_is_not_the_block(toy) -> None:
    """It has the block's shape, but not its colour, which was learnt while the block lay apart."""
    for color, expected in ((RED, 1), (GREEN, 0)):
        said = after_a_red_block_apart(toy, toy.assembly, color)
        assert said is not None
        assert said[expected] > 0.95


def test_what_a_part_looks_like_is_known_from_its_twin(toy) -> None:
    """The state joins a twin of the block; the block's colour was learnt while it lay apart."""
    block, last = toy.assembly.parts["block"], toy.assembly.states[1]
    twin = replace(block, name="block-Copy")
    places = {"base": np.eye(4), "block-Copy": last.T_base_part["block"]}
    pair = replace(
        toy.assembly,
        parts={**toy.assembly.parts, "block-Copy": twin},
        states=(toy.assembly.states[0], replace(last, T_base_part=places)),
    )
    for color, expected in ((RED, 1), (GREEN, 0)):
        said = after_a_red_block_apart(toy, pair, color)
        assert said is not None
        assert said[expected] > 0.95


def test_colours_that_nobody_saw_may_be_those_of_another_part(toy) -> None:
    """Or the parts behind would be believed for knowing their colours."""
    true = toy.poses(joined=True)
    frame = toy.frame(1, true)
    corners = project(apply(true["base"], toy.assembly.parts["base"].mesh.vertices), frame.camera.K)
    view = view_of(corners, frame, frame.depth, cells=50)
    assert view is not None
    seen = view.features[20, 20].astype(np.float64)
    look = Look(seen, np.full(3, 0.05))
    blank = np.zeros(view.depth.shape, np.float32)
    measured = measured_in(
        view, blank, [look, None], black=[True, False], base=0, config=GroupFitConfig()
    )
    assert measured.ratios[0].max() > 0
    np.testing.assert_array_equal(measured.ratios[1], np.maximum(measured.ratios[0], 0))
    dark = frame.rgb.mean() <= GroupFitConfig().black_seen
    assert bool(measured.swallowed[0].any()) == dark
    assert not measured.swallowed[1:].any()


def test_without_depth_or_switched_off_it_is_silent(toy) -> None:
    true = toy.poses(joined=True)
    poses = found(true["base"])
    assert fits_of(toy.assembly).step(poses, KNOWN, toy.frame(1)) is None
    assert fits_of(toy.assembly, enabled=False).step(poses, KNOWN, toy.frame(1, true)) is None
    assert fits_of(toy.assembly).step({}, None, toy.frame(1, true)) is None


def test_a_view_needs_pixels_in_the_picture(toy) -> None:
    frame = toy.frame(1, toy.poses(joined=True))
    outside = np.array([[-50.0, -50.0], [-10.0, -20.0]])
    behind = np.full((3, 2), np.nan)
    assert view_of(outside, frame, frame.depth, cells=50) is None
    assert view_of(behind, frame, frame.depth, cells=50) is None
    view = view_of(np.array([[100.0, 80.0], [200.0, 160.0]]), frame, frame.depth, cells=50)
    assert view is not None
    assert max(view.depth.shape) <= 50 + 2 * 9
    u, v = 40, 30  # a cell and the pixel that it shows
    pixel = np.array([view.K[0, 2], view.K[1, 2]]) - [u, v]
    full = np.array([159.5, 119.5]) - np.array([2 * pixel[0], 2 * pixel[1]])
    assert view.depth[v, u] == frame.depth[int(full[1]), int(full[0])]


@pytest.mark.parametrize("off", [(0.0, 0.0, 0.012), (0.0, 0.0, 0.02), (0.01, 0.0, 0.0)])
def test_a_part_on_its_way_in_is_not_in(toy, off: tuple[float, float, float]) -> None:
    """From there it covers most of what it covers in its place; its own pose tells, if it is known."""
    near = toy.poses(joined=True)
    shift = near["base"] @ transform_from(np.eye(3), np.array(off))
    near["block"] = shift @ toy.assembly.states[1].T_base_part["block"]
    frame = noisy(toy.frame(1, {n: near[n] for n in ("base", "block")}))
    said: list[float] = []
    for score in (0.8, 0.3):
        poses = found(near["base"])
        poses["block"] = PoseEstimate("block", near["block"], score, "refined")
        probabilities = fits_of(toy.assembly).step(poses, KNOWN, frame)
        assert probabilities is not None
        said.append(probabilities[1])
    assert said[0] < 0.001
    assert said[1] > 0.5


def test_a_part_whose_own_pose_lags_behind_is_in_all_the_same(toy) -> None:
    true = toy.poses(joined=True)
    up = true["base"] @ transform_from(np.eye(3), np.array([0.0, 0.0, 0.02]))
    poses = found(true["base"])
    place = toy.assembly.states[1].T_base_part["block"]
    poses["block"] = PoseEstimate("block", up @ place, 0.9, "refined")
    said = fits_of(toy.assembly).step(poses, KNOWN, noisy(toy.frame(1, true)))
    assert said is not None
    assert said[1] > 0.95


def test_more_of_a_scene_agrees_that_is_smeared_as_the_camera_smears(toy) -> None:
    true, smear = toy.poses(joined=True), Smear(deviation=0.012)
    sharp = toy.frame(1, true)
    depth = smear.applied(sharp.depth.astype(np.float64), focal=float(sharp.camera.K[0, 0]))
    frame = replace(sharp, depth=depth)
    seen = SeenSmear(toy.assembly.parts, config=SmearConfig())
    seen.now = smear
    shapes = part_shapes(toy.assembly, surface_points=900)
    shares: list[float] = []
    for config in (GroupFitConfig(smeared=False), GroupFitConfig()):
        fits = GroupFits(toy.assembly, shapes, config=config, smear=seen)
        said = fits.step(found(true["base"]), KNOWN, frame)
        assert said is not None
        assert said[1] > 0.9
        assert fits.base is not None
        shares.append(fits.base.score)
    assert shares[1] > shares[0] + 0.02
