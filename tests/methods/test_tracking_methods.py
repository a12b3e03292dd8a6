"""The methods that track, on a drawn scene: a block is carried onto a base, a hand hides it at times."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar

import cv2
import numpy as np
import pytest

from asdfviz.datatypes import (
    Assembly,
    Frame,
    FramePrediction,
    Joint,
    Mesh,
    PoseEstimate,
    State,
    StateEstimate,
)
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.symmetry import Symmetries
from asdfviz.geometry.transforms import inverse, rotation_about, rotation_angle, transform_from
from asdfviz.methods import tracking
from asdfviz.methods.asdf_track import AsdfTrack
from asdfviz.methods.asdf_track_config import AsdfTrackConfig, JoinConfig
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.contour_fits import ContourConfig, ContourFits
from asdfviz.methods.following import FollowConfig
from asdfviz.methods.gbot import Gbot, GbotConfig
from asdfviz.methods.gbot_reinit import GbotReinit, GbotReinitConfig
from asdfviz.methods.group_contours import GroupContours
from asdfviz.methods.part_tracks import PartTracks
from asdfviz.methods.refinding import RefindConfig, turned
from asdfviz.methods.registry import available_methods, build_method, find_method
from asdfviz.methods.spec import MethodSpec
from asdfviz.methods.step_places import StepPlacesConfig
from asdfviz.methods.timing import StageTimer
from asdfviz.methods.turn_config import TurnConfig
from asdfviz.track import raster
from asdfviz.track.presets import FINE, GBOT, PROPOSED, RBOT_REGION, TrackerConfig

COLORS = {"base": (30, 60, 200), "block": (220, 120, 20)}
KNOBS = {"base": (-0.045, 0.025, 0.015), "block": (0.01, 0.02, 0.025)}
"""Middle of a knob on each part, metres, without which a box looks alike from all sides."""
FRAMES = 12
ARRIVED = 8
"""Frame from which the block is joined."""


pytestmark = pytest.mark.usefixtures("small_models", "shapes_unchecked")


@dataclass(frozen=True, eq=False)
class Scene:
    """Frames with the truth that made them."""

    assembly: Assembly
    truth: list[dict[str, Transform]]
    frames: list[Frame]
    draw: Callable[[Assembly, Mapping[str, Transform], int], Frame]

    def initial(self, *names: str) -> FramePrediction:
        poses = {n: PoseEstimate(n, self.truth[0][n], 1.0, "truth") for n in names}
        return FramePrediction(0, poses, None)

    def only(self, assembly: Assembly, index: int) -> Frame:
        """A frame in which only the parts of another assembly are drawn."""
        return self.draw(assembly, {n: self.truth[index][n] for n in assembly.parts}, index)

    def off_mm(self, prediction: FramePrediction, name: str) -> float:
        """Distance of the part's middle (its origin, here) from the truth."""
        T = self.truth[prediction.frame_index][name]
        return float(1e3 * np.linalg.norm((prediction.poses[name].T_camera_part - T)[:3, 3]))


@pytest.fixture
def scene(toy) -> Scene:
    parts = {name: toy.assembly.parts[name] for name in COLORS}
    colored = {
        n: replace(p, color=np.array(COLORS[n], np.uint8), mesh=with_knob(p.mesh, KNOBS[n]))
        for n, p in parts.items()
    }
    assembly = replace(toy.assembly, parts=colored)
    end = toy.poses(joined=True)["block"]
    truth = []
    for i in range(FRAMES):
        share = min(i / ARRIVED, 1.0)
        T = end.copy()
        T[:3, 3] -= (1 - share) * np.array([0.05, 0.02, 0.02])
        truth.append({"base": toy.poses(joined=True)["base"], "block": T})
    frames = [drawn(assembly, T, i, toy) for i, T in enumerate(truth)]
    return Scene(assembly, truth, frames, partial(drawn, toy=toy))


def with_knob(mesh: Mesh, middle: tuple[float, float, float]) -> Mesh:
    count = len(mesh.vertices)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    knob = (mesh.vertices - (low + high) / 2) / (high - low) * 0.02 + np.array(middle)
    return Mesh(
        np.concatenate([mesh.vertices, knob]), np.concatenate([mesh.faces, mesh.faces + count])
    )


def drawn(assembly: Assembly, poses: Mapping[str, Transform], index: int, toy) -> Frame:
    camera = toy.frame(0).camera
    rng = np.random.default_rng(index)
    inverse_depth, ids = raster.new_buffers(camera.width, camera.height)
    for number, (name, T) in enumerate(poses.items()):
        raster.draw(
            assembly.parts[name].mesh,
            T,
            K=camera.K,
            inverse_depth=inverse_depth,
            ids=ids,
            number=number,
        )
    rgb = rng.integers(90, 150, (camera.height, camera.width, 3)).astype(np.float64)
    for number, name in enumerate(poses):
        inside = ids == number
        noise = rng.normal(0, 2, 3) + rng.normal(0, 5, (int(inside.sum()), 3))
        rgb[inside] = assembly.parts[name].color + noise
    rgb[0, 0] = index  # what the fake detector reads
    depth = np.where(inverse_depth > 0, 1 / np.maximum(inverse_depth, 1e-6), 0.9)
    depth += rng.normal(0, 5e-4, depth.shape)
    rgb = np.clip(rgb, 0, 255).astype(np.uint8)
    return Frame(index, 0.1 * index, rgb, depth.astype(np.float32), camera)


def hidden(frame: Frame) -> Frame:
    """The same frame behind a board."""
    assert frame.depth is not None
    rgb = np.full_like(frame.rgb, 100)
    rgb[0, 0] = frame.index
    return replace(frame, rgb=rgb, depth=np.full_like(frame.depth, 0.2))


def play(method, scene: Scene, initial: FramePrediction | None) -> list[FramePrediction]:
    method.reset(scene.assembly, scene.frames[0].camera, initial)
    return [method.step(frame) for frame in scene.frames]


def test_all_trackers_are_listed_with_their_start() -> None:
    methods = available_methods()
    for name in ("srt3d", "icg", "icg_srt3d", "gbot", "gbot_reinit", "asdf_track"):
        spec = methods[name]
        assert isinstance(spec, MethodSpec)
        assert spec.name == name
        assert spec.initial == ("none" if name == "asdf_track" else "first_frame_truth")
        build_method(spec)
    assert find_method("icg").predicts == {"pose"}
    assert find_method("gbot").predicts == {"pose", "state"}


@pytest.mark.parametrize(
    ("name", "limits_mm"),
    [
        ("srt3d", {"base": 12}),  # colour alone, at 20 pixels a part, holds what rests
        ("icg", {"base": 4, "block": 4}),
        ("icg_srt3d", {"base": 4, "block": 4}),
    ],
)
def test_parts_are_carried_from_the_first_frame(
    name: str, limits_mm: dict[str, float], scene: Scene
) -> None:
    said = play(build_method(find_method(name)), scene, scene.initial("base", "block"))
    assert said[0].state is None
    assert {p.stage for p in said[0].poses.values()} == {"tracked"}
    for part, limit_mm in limits_mm.items():
        assert max(scene.off_mm(p, part) for p in said[:ARRIVED]) < limit_mm


def test_lost_parts_are_absent_unless_asked_for(scene: Scene) -> None:
    scene = replace(scene, frames=[*scene.frames[:4], *map(hidden, scene.frames[4:])])
    spec = find_method("icg_srt3d")
    start = scene.initial("base", "block")
    config = replace(spec.config(), follow=FollowConfig(kept=0.5))
    said = play(build_method(spec, config), scene, start)
    assert set(said[3].poses) == {"base", "block"}
    # What is hidden is taken to stay for a while, with less and less confidence.
    scores = [p.poses["block"].score for p in said[3:5]]
    assert scores[1] < scores[0]
    assert not said[-1].poses
    told = play(build_method(spec, replace(config, report_lost=True)), scene, start)
    assert set(told[-1].poses) == {"base", "block"}
    assert told[-1].poses["block"].score < 0.2
    as_published = play(build_method(spec, replace(config, published=True)), scene, start)
    assert set(as_published[3].poses) == {"base", "block"}
    assert not as_published[-1].poses


def test_a_part_that_was_hidden_and_moved_is_not_taken_for_what_lies_there(scene: Scene) -> None:
    """The block is carried off behind a board; the tracker does not settle on the wall or the base."""
    gone = replace(scene.assembly, parts={"base": scene.assembly.parts["base"]})
    frames = [*scene.frames[:3], *map(hidden, scene.frames[3:5])]
    frames += [scene.only(gone, i) for i in range(5, FRAMES)]
    said = play(
        build_method(find_method("icg")),
        replace(scene, frames=frames),
        scene.initial("base", "block"),
    )
    assert set(said[2].poses) == {"base", "block"}
    assert all(set(p.poses) == {"base"} for p in said[6:])


@pytest.mark.parametrize("tried", [True, False])
def test_a_part_that_was_taken_too_deep_is_found_on_its_ray(*, tried: bool, scene: Scene) -> None:
    follow = FollowConfig() if tried else FollowConfig(off_depth=np.inf)
    following = tracking.Following(
        scene.assembly,
        scene.frames[0].camera,
        tracking.PartTrackerConfig(follow=follow, report_lost=True),
    )
    following.start(scene.frames[0], scene.initial("base", "block"))
    following.update(scene.frames[0], StageTimer())
    T_deep = following.tracker.poses["block"].copy()
    T_deep[:3, 3] *= 1 + 0.06 / T_deep[2, 3]  # past what the tracker takes for something before it
    following.tracker.replace(scene.frames[0], {"block": T_deep})
    following.placed(["block"])
    poses = following.update(scene.frames[0], StageTimer())
    off_mm = scene.off_mm(FramePrediction(0, poses, None), "block")
    assert off_mm < 3 if tried else off_mm > 20


def shaken(scene: Scene, toy, shift: float) -> Scene:
    """Four parts that lie still before a camera that moves to the side in the second frame and back."""
    base, block = (scene.assembly.parts[name] for name in COLORS)
    assembly = replace(
        scene.assembly, parts={"base": base, **{name: replace(block, name=name) for name in "abc"}}
    )
    places = {"a": (-0.14, -0.1), "b": (0.16, -0.1), "c": (-0.14, 0.12)}
    truth = []
    for i in range(4):
        T_shift = transform_from(np.eye(3), np.array([shift * (i == 1), 0.0, 0.0]))
        lying = {"base": scene.truth[0]["base"]}
        for name, (x, y) in places.items():
            R = rotation_about(np.array([0.3, 1.0, 0.2]), 0.6)
            lying[name] = transform_from(R, np.array([x, y, 0.55]))
        truth.append({name: T_shift @ T for name, T in lying.items()})
    frames = [drawn(assembly, T, i, toy) for i, T in enumerate(truth)]
    return Scene(assembly, truth, frames, scene.draw)


@pytest.mark.parametrize("enabled", [True, False])
def test_a_hidden_part_stays_where_it_lies_as_the_camera_moves(
    *, enabled: bool, scene: Scene, toy
) -> None:
    moved = shaken(scene, toy, 0.02)
    behind = hidden(moved.frames[1])
    left = np.s_[:, : moved.frames[1].camera.width // 3]
    upper = moved.frames[1].camera.height // 2
    for name in ("rgb", "depth"):  # a board before the third block
        getattr(moved.frames[1], name)[upper:][left] = getattr(behind, name)[upper:][left]
    follow = FollowConfig(at_rest=AtRestConfig(enabled=enabled, enough=1))
    method = tracking.PartTracker(tracking.PartTrackerConfig(follow=follow, report_lost=True))
    method.reset(moved.assembly, moved.frames[0].camera, moved.initial("base", *"abc"))
    said = [method.step(frame) for frame in moved.frames[:2]]
    assert all(moved.off_mm(said[1], name) < 3 for name in ("base", "a", "b"))
    off_mm = moved.off_mm(said[1], "c")
    assert off_mm < 4 if enabled else off_mm > 15


@pytest.mark.parametrize("enabled", [True, False])
def test_a_part_that_slipped_as_the_camera_moved_is_put_back(
    *, enabled: bool, scene: Scene, toy
) -> None:
    moved = shaken(scene, toy, 0.02)
    follow = FollowConfig(at_rest=AtRestConfig(enabled=enabled, enough=1))
    config = tracking.PartTrackerConfig(follow=follow, report_lost=True)
    following = tracking.Following(moved.assembly, moved.frames[0].camera, config)
    following.start(moved.frames[0], moved.initial("base", *"abc"))
    for frame in moved.frames[:2]:
        following.update(frame, StageTimer())
    T_slipped = moved.truth[2]["c"].copy()
    T_slipped[1, 3] -= 0.11  # farther than the tracker sees
    following.tracker.replace(moved.frames[2], {"c": T_slipped})
    following.placed(["c"])
    poses = following.update(moved.frames[2], StageTimer())
    off_mm = moved.off_mm(FramePrediction(2, poses, None), "c")
    assert off_mm < 3 if enabled else off_mm > 30


def test_published_settings_are_those_of_the_papers() -> None:
    for name, settings in (("srt3d", RBOT_REGION), ("icg", GBOT), ("gbot", GBOT)):
        config = find_method(name).config
        assert replace(config(), published=True).settings == settings


def test_a_part_that_the_first_frame_lacks_stays_absent(scene: Scene) -> None:
    said = play(build_method(find_method("icg")), scene, scene.initial("base"))
    assert set(said[0].poses) == {"base"}
    assert all("block" not in p.poses for p in said)


@pytest.mark.parametrize("name", ["icg", "gbot"])
def test_a_tracker_without_a_start_is_refused(name: str, scene: Scene) -> None:
    method = build_method(find_method(name))
    with pytest.raises(MethodError, match="first frame"):
        method.reset(scene.assembly, scene.frames[0].camera, None)
    with pytest.raises(MethodError, match="reset"):
        method.step(scene.frames[0])


def test_gbot_reaches_the_state_and_links_its_parts(scene: Scene) -> None:
    said = play(Gbot(GbotConfig(tracker=FINE)), scene, scene.initial("base", "block"))
    states = [p.state.index for p in said if p.state is not None]
    assert states == sorted(states)
    assert states[0] == 0
    assert states[ARRIVED:] == [1] * (FRAMES - ARRIVED)
    poses = {n: p.T_camera_part for n, p in said[-1].poses.items()}
    T = np.linalg.inv(poses["base"]) @ poses["block"]
    np.testing.assert_allclose(T, scene.assembly.states[1].T_base_part["block"], atol=1e-9)
    # It never joins a part that stays away.
    away = replace(scene, frames=scene.frames[:1] * 4, truth=scene.truth[:1] * 4)
    for p in play(Gbot(GbotConfig(tracker=FINE)), away, scene.initial("base", "block")):
        assert p.state is not None
        assert p.state.index == 0


def off(T: Transform, metres: float, degrees: float) -> Transform:
    change = transform_from(rotation_about(np.array([0, 0, 1.0]), np.deg2rad(degrees)), np.zeros(3))
    change[0, 3] = metres
    return T @ change


@dataclass(frozen=True)
class StillConfig(GbotReinitConfig):
    """Published behaviour, with an optimiser that hardly moves."""

    PUBLISHED: ClassVar[TrackerConfig] = replace(
        FINE, optimizer=replace(FINE.optimizer, rotation=1e15, translation=1e15)
    )


@pytest.mark.parametrize(
    ("angle_deg", "turned_by", "joined"),
    [(None, 30.0, False), (45.0, 30.0, True), (45.0, 60.0, False)],
)
def test_gbot_joins_what_is_not_turned_too_far(
    angle_deg: float | None, turned_by: float, *, joined: bool, scene: Scene
) -> None:
    # As in the next test, nothing moves that is tracked.
    config = StillConfig(published=True, angle_deg=angle_deg)
    T_end = off(scene.truth[-1]["block"], 0.0, turned_by)
    poses = {"base": scene.truth[-1]["base"], "block": T_end}
    start = {n: PoseEstimate(n, T, 1.0, "truth") for n, T in poses.items()}
    method = Gbot(config)
    method.reset(scene.assembly, scene.frames[0].camera, FramePrediction(0, start, None))
    state = method.step(scene.frames[-1]).state
    assert state is not None
    assert state.index == joined


@pytest.mark.parametrize("sought", [True, False])
def test_gbot_finds_what_was_joined_out_of_sight(*, sought: bool, scene: Scene, toy) -> None:
    """The block lies far off, is carried behind a board and turns up on the base."""
    base, apart = scene.truth[-1]["base"], toy.poses(joined=False)["block"]
    left = {"base": base, "block": apart}
    scene.truth[:5] = [left] * 5
    scene.truth[5:] = [scene.truth[-1]] * (FRAMES - 5)
    frames = [scene.draw(scene.assembly, T, i) for i, T in enumerate(scene.truth)]
    frames[3:5] = map(hidden, frames[3:5])
    config = GbotConfig(places=StepPlacesConfig(enabled=sought, frames=2))
    said = play(Gbot(config), replace(scene, frames=frames), scene.initial("base", "block"))
    states = [p.state.index for p in said if p.state is not None]
    assert states[:5] == [0] * 5
    assert states[-1] == sought
    assert ("block" in said[-1].poses) == sought
    if sought:
        assert scene.off_mm(said[-1], "block") < 4


def sliding(scene: Scene, way: float, *, joint: Joint | None = None) -> Scene:
    """The block is joined, then pushed on by a step of its own after frame 5."""
    base, joined = scene.assembly.states
    T_pushed = joined.T_base_part["block"].copy()
    T_pushed[0, 3] -= way
    joints = {} if joint is None else {"block": joint}
    pushed = State(2, "pushed", {"base": np.eye(4), "block": T_pushed})
    states = (base, replace(joined, joints=joints), pushed)
    assembly = replace(scene.assembly, states=states)
    T_base = scene.truth[-1]["base"]
    places = [states[1 if i < 6 else 2].T_base_part["block"] for i in range(FRAMES)]
    truth = [{"base": T_base, "block": T_base @ T} for T in places]
    frames = [scene.draw(assembly, T, i) for i, T in enumerate(truth)]
    return Scene(assembly, truth, frames, scene.draw)


@pytest.mark.parametrize("published", [True, False])
@pytest.mark.parametrize("slides", [True, False])
@pytest.mark.parametrize("way", [0.015, 0.06])
def test_gbot_takes_a_step_that_moves_a_joined_part_once_it_is_seen_there(
    *, way: float, slides: bool, published: bool, scene: Scene
) -> None:
    joint = Joint("prismatic", np.array([1.0, 0, 0]), np.zeros(3), slide=(-way, 0.0))
    moved = sliding(scene, way, joint=joint if slides else None)
    config = GbotConfig(published=published, places=StepPlacesConfig(frames=2))
    start = replace(moved.initial("base", "block"), state=StateEstimate(np.array([0.0, 1, 0])))
    said = play(Gbot(config), moved, start)
    states = [p.state.index for p in said if p.state is not None]
    assert states[:6] == [1] * 6
    if not published:  # as published, what is held fast cannot be seen elsewhere
        assert states[-1] == 2
        assert moved.off_mm(said[-1], "block") < 4
    still = replace(moved, frames=moved.frames[:1] * FRAMES)
    told = play(Gbot(config), still, start)
    assert [p.state.index for p in told if p.state is not None] == [1] * FRAMES


HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])


def looks_the_same_turned(scene: Scene, toy) -> Scene:
    """The scene with a base that has no knob and looks the same after half a turn."""
    base = replace(
        scene.assembly.parts["base"],
        mesh=toy.assembly.parts["base"].mesh,
        symmetries=Symmetries(discrete=(HALF_TURN,)),
    )
    assembly = replace(scene.assembly, parts={**scene.assembly.parts, "base": base})
    frames = [scene.draw(assembly, T, i) for i, T in enumerate(scene.truth)]
    return replace(scene, assembly=assembly, frames=frames)


def test_gbot_joins_a_part_to_a_base_that_is_tracked_turned_and_looks_the_same(
    scene: Scene, toy
) -> None:
    scene = looks_the_same_turned(scene, toy)
    start = scene.initial("base", "block")
    turned_base = replace(start.poses["base"], T_camera_part=scene.truth[0]["base"] @ HALF_TURN)
    start = replace(start, poses={**start.poses, "base": turned_base})
    said = play(Gbot(GbotConfig(tracker=FINE)), scene, start)
    states = [p.state.index for p in said if p.state is not None]
    assert states[0] == 0
    assert states[ARRIVED + 1 :] == [1] * (FRAMES - ARRIVED - 1)
    assert scene.off_mm(said[-1], "block") < 4


def test_reinit_leaves_a_base_that_looks_the_same_turned_as_it_is_tracked(
    scene: Scene, toy, detector
) -> None:
    scene = looks_the_same_turned(scene, toy)
    config = StillConfig(published=True, every=1, faithful=True)
    T_base, T_block = scene.truth[-1]["base"], scene.truth[-1]["block"]
    for i in range(2):
        detector.answers[i] = (toy.detection("base", T_base @ HALF_TURN),)
    frames = [scene.draw(scene.assembly, scene.truth[-1], i) for i in range(2)]
    start = {n: PoseEstimate(n, T, 1.0, "truth") for n, T in scene.truth[-1].items()}
    method = GbotReinit(config, detector=detector)
    said = play(method, replace(scene, frames=frames), FramePrediction(0, start, None))
    for p in said:
        np.testing.assert_allclose(p.poses["base"].T_camera_part, T_base, atol=3e-3)
        np.testing.assert_allclose(p.poses["block"].T_camera_part, T_block, atol=3e-3)


def test_gbot_has_its_own_bounds_for_joining_unless_published() -> None:
    assert GbotConfig(published=True).joins_within == (0.04, 20.0)
    assert GbotConfig().joins_within == (0.03, 45.0)
    assert GbotConfig(near=0.02).joins_within == (0.02, 45.0)


@pytest.mark.parametrize(
    ("metres", "degrees", "faithful", "replaced"),
    [
        (0.03, 0.0, False, False),
        (0.0, 15.0, False, False),
        (0.06, 0.0, False, True),
        (0.0, 30.0, False, True),
        (0.03, 0.0, True, True),
    ],
)
def test_reinit_keeps_what_is_near_the_detector(
    metres: float, degrees: float, *, faithful: bool, replaced: bool, scene: Scene, toy, detector
) -> None:
    # A tracker that is too cautious to move shows which pose it was given.
    config = StillConfig(published=True, every=1, faithful=faithful, report_lost=True)
    seen = off(scene.truth[0]["base"], metres, degrees)
    detector.answers[0] = (toy.detection("base", seen),)
    method = GbotReinit(config, detector=detector)
    method.reset(scene.assembly, scene.frames[0].camera, scene.initial("base"))
    T = method.step(scene.frames[0]).poses["base"].T_camera_part
    expected = seen if replaced else scene.truth[0]["base"]
    np.testing.assert_allclose(T, expected, atol=3e-3)


def test_reinit_believes_the_picture_and_not_a_poor_detection(scene: Scene, toy, detector) -> None:
    for i, truth in enumerate(scene.truth):
        poor = {n: off(T, 0.08, 60.0) for n, T in truth.items()}
        detector.answers[i] = tuple(toy.detection(n, T) for n, T in poor.items())
    method = GbotReinit(GbotReinitConfig(every=2), detector=detector)
    said = play(method, scene, scene.initial("base", "block"))
    # GBOT joins a part before it has arrived; it is absent until then.
    assert set(said[-1].poses) == {"base", "block"}
    assert max(scene.off_mm(p, n) for p in said for n in p.poses) < 5


def test_reinit_finds_a_lost_part_soon(scene: Scene, toy, detector) -> None:
    """The block goes far while it is hidden; the detector then sees it 10 mm off and turned."""
    away = transform_from(np.eye(3), np.array([-0.12, -0.05, 0.0]))
    truth = [{**scene.truth[0]} for _ in range(FRAMES)]
    for T in truth[5:]:
        T["block"] = away @ T["block"]
    frames = [hidden(f) if f.index in (3, 4) else f for f in scene.frames]
    frames = [
        f if i in (3, 4) else scene.draw(scene.assembly, truth[i], i) for i, f in enumerate(frames)
    ]
    for i in range(5, FRAMES):
        detector.answers[i] = (toy.detection("block", off(truth[i]["block"], 0.01, 25.0)),)
    moved = replace(scene, truth=truth, frames=frames)
    config = GbotReinitConfig(every=100, follow=FollowConfig(kept=0.5))
    said = play(GbotReinit(config, detector=detector), moved, moved.initial("base", "block"))
    assert moved.off_mm(said[2], "block") < 5
    assert "block" not in said[6].poses or moved.off_mm(said[6], "block") < 5
    assert moved.off_mm(said[-1], "block") < 5


def test_reinit_takes_in_a_part_that_comes_later(scene: Scene, toy, detector) -> None:
    method = GbotReinit(GbotReinitConfig(tracker=FINE, every=3), detector=detector)
    for i, truth in enumerate(scene.truth):
        detector.answers[i] = (toy.detection("block", truth["block"]),)
    said = play(method, scene, scene.initial("base"))
    assert set(said[1].poses) == {"base"}
    assert set(said[2].poses) == {"base", "block"}
    assert scene.off_mm(said[-1], "block") < 5


@pytest.mark.parametrize("checked", [True, False])
def test_reinit_turns_what_it_follows_end_for_end(scene: Scene, detector, *, checked: bool) -> None:
    """The block lies with its knob up and is handed over end for end; no detector sees it."""
    R, centre = np.diag([1.0, -1, -1]), tracking.load_bodies(scene.assembly)["block"].balance
    wrong = scene.truth[0]["block"]
    poses = {**scene.truth[0], "block": turned(wrong, R, centre=centre)}
    config = GbotReinitConfig(turns=TurnConfig(enabled=checked), report_lost=True)
    method = GbotReinit(config, detector=detector)
    method.reset(scene.assembly, scene.frames[0].camera, scene.initial("base", "block"))
    said = [method.step(scene.draw(scene.assembly, poses, i)) for i in range(6)]
    found = said[-1].poses["block"].T_camera_part
    angle = rotation_angle(found[:3, :3].T @ poses["block"][:3, :3])
    assert angle < 0.1 if checked else angle > 2


Answers = Callable[[int], bool]


def asdf_track(scene: Scene, toy, detector, *, sees: Answers) -> list[FramePrediction]:
    """Let the method run with a detector that is 15 mm off, in the frames that `sees` allows."""
    for i, truth in enumerate(scene.truth):
        boxes = [toy.detection(n, off(T, 0.015, 10.0), seed=i) for n, T in truth.items()]
        state = [toy.state_box(0.7)] if i >= ARRIVED else []
        detector.answers[i] = (*boxes, *state) if sees(i) else ()
    return play(AsdfTrack(AsdfTrackConfig(), detector=detector), scene, None)


def test_asdf_track_is_nearer_than_its_detector_and_joins(scene: Scene, toy, detector) -> None:
    said = asdf_track(scene, toy, detector, sees=lambda i: i < 3 or i > ARRIVED)
    for p in said:
        for name in ("base", "block"):
            assert scene.off_mm(p, name) < 5
    states = [p.state.index for p in said if p.state is not None]
    assert states[0] == 0
    assert states[-1] == 1
    assert set(said[0].runtime) >= {"detect", "refind", "track", "fuse"}


def test_asdf_track_joins_to_a_base_that_is_found_turned_and_looks_the_same(
    scene: Scene, toy, detector
) -> None:
    scene = looks_the_same_turned(scene, toy)
    for i, truth in enumerate(scene.truth):
        seen = {**truth, "base": truth["base"] @ HALF_TURN}
        detector.answers[i] = tuple(toy.detection(n, T, seed=i) for n, T in seen.items())
    scene.frames.extend(scene.draw(scene.assembly, scene.truth[-1], i) for i in range(12, 16))
    detector.answers |= dict.fromkeys(range(12, 16), detector.answers[FRAMES - 1])
    said = play(AsdfTrack(AsdfTrackConfig(), detector=detector), scene, None)
    assert said[-1].state is not None
    assert said[-1].state.index == 1
    assert said[-1].poses["block"].stage == "group"
    T_base_block = (
        inverse(said[-1].poses["base"].T_camera_part) @ said[-1].poses["block"].T_camera_part
    )
    np.testing.assert_allclose(
        T_base_block, scene.assembly.states[1].T_base_part["block"], atol=1e-3
    )
    T = scene.truth[-1]["block"]
    assert np.linalg.norm((said[-1].poses["block"].T_camera_part - T)[:3, 3]) < 0.004


def test_asdf_track_takes_the_plate_that_parts_are_joined_to_for_the_base(
    scene: Scene, toy, detector
) -> None:
    twin = replace(scene.assembly.parts["base"], name="base-copy")
    assembly = replace(scene.assembly, parts={**scene.assembly.parts, "base-copy": twin})
    left = transform_from(np.eye(3), np.array([-0.15, 0, 0]))
    # From the start the block is joined, to the plate on the right.
    truth = {**scene.truth[-1], "base-copy": left @ scene.truth[-1]["base"]}
    frames = [scene.draw(assembly, truth, i) for i in range(FRAMES)]
    shown = replace(toy, assembly=assembly)
    boxes = tuple(shown.detection(name, T) for name, T in truth.items())
    detector.answers |= dict.fromkeys(range(FRAMES), boxes)
    scene = replace(scene, assembly=assembly, frames=frames, truth=[truth] * FRAMES)
    said = play(AsdfTrack(AsdfTrackConfig(), detector=detector), scene, None)
    assert said[-1].state is not None
    assert said[-1].state.index == 1
    for name in truth:
        assert scene.off_mm(said[-1], name) < 5


def test_asdf_track_finds_parts_again(scene: Scene, toy, detector) -> None:
    frames = [hidden(f) if f.index in (2, 3) else f for f in scene.frames]
    # What was hidden moved on by much more than a tracker follows.
    truth = [T if i < 2 else scene.truth[-1] for i, T in enumerate(scene.truth)]
    frames = [f if i < 4 else replace(scene.frames[-1], index=i) for i, f in enumerate(frames)]
    scene = replace(scene, frames=frames, truth=truth)
    detector.answers[FRAMES - 1] = tuple(
        toy.detection(n, off(T, 0.015, 10.0)) for n, T in truth[-1].items()
    )
    for i in range(2):
        detector.answers[i] = tuple(toy.detection(n, T) for n, T in truth[i].items())
    method = AsdfTrack(AsdfTrackConfig(), detector=detector)
    said = play(method, scene, None)
    assert scene.off_mm(said[1], "block") < 5
    assert scene.off_mm(said[-1], "block") < 5
    assert scene.off_mm(said[-1], "base") < 5


@pytest.mark.parametrize(("missing", "is_found"), [(3, True), (FRAMES, False)])
def test_a_part_whose_colours_were_learnt_on_something_else_begins_anew(
    scene: Scene, toy, detector, missing: int, is_found: bool
) -> None:
    """Something grey of its shape lies on a cloth of the block's colour; then the block lies beside."""
    grey = replace(scene.assembly.parts["block"], color=np.array([120, 120, 120], np.uint8))
    other = replace(scene.assembly, parts={**scene.assembly.parts, "block": grey})
    before, after = scene.truth[0], scene.truth[3]
    truth = [before] * 4 + [after] * (FRAMES - 4)
    frames = [scene.draw(scene.assembly if i >= 4 else other, T, i) for i, T in enumerate(truth)]
    for frame in frames[:4]:
        assert frame.depth is not None
        frame.rgb[1:][frame.depth[1:] > 0.8] = COLORS["block"]
    moved = replace(scene, truth=truth, frames=frames)
    for i, poses in enumerate(truth):
        detector.answers[i] = tuple(toy.detection(n, T, seed=i) for n, T in poses.items())
    config = AsdfTrackConfig(refind=RefindConfig(missing=missing))
    said = play(AsdfTrack(config, detector=detector), moved, None)
    assert moved.off_mm(said[3], "block") < 5
    assert "block" not in said[5].poses
    assert ("block" in said[-1].poses) == is_found
    assert not is_found or moved.off_mm(said[-1], "block") < 5


def test_a_part_that_no_box_shows_is_absent_until_the_state_joins_it(
    scene: Scene, toy, detector
) -> None:
    detector.answers = {i: (toy.detection("base", T["base"]),) for i, T in enumerate(scene.truth)}
    config = AsdfTrackConfig(join=JoinConfig(settled=0.9))  # the scene is soon over
    said = play(AsdfTrack(config, detector=detector), scene, None)
    assert all(set(p.poses) == {"base"} for p in said[:ARRIVED])
    placed = said[-1].poses["block"]
    assert placed.stage == "group"
    assert scene.off_mm(said[-1], "block") < 5


@pytest.mark.parametrize("joined", [("block", "twin"), ("block",), ()])
def test_a_hidden_base_is_where_two_joined_parts_that_are_seen_have_it(
    scene: Scene, joined: tuple[str, ...]
) -> None:
    base, block = scene.truth[-1]["base"], scene.assembly.parts["block"]
    places = {"block": inverse(base) @ scene.truth[-1]["block"]}
    places["twin"] = transform_from(np.eye(3), np.array([-0.06, 0, 0])) @ places["block"]
    parts = {**scene.assembly.parts, "twin": replace(block, name="twin")}
    state = State(0, "both", {"base": np.eye(4), **{name: places[name] for name in joined}})
    assembly = replace(scene.assembly, parts=parts, states=(state,), transitions=frozenset())
    truth = {"base": base, **{name: base @ T for name, T in places.items()}}
    whole = scene.draw(assembly, truth, 0)
    without = scene.draw(assembly, {n: T for n, T in truth.items() if n != "base"}, 0)
    tracks = PartTracks(
        assembly, whole.camera, tracker=PROPOSED, refind=RefindConfig(), turns=TurnConfig()
    )
    proposed = {n: PoseEstimate(n, T, 0.8, "refined") for n, T in truth.items()}
    said: dict[str, PoseEstimate] = {}
    for i in range(25):
        frame = whole if i < 6 else board_over_base(whole, without)
        tracks.refind(frame, proposed if i < 6 else {}, {}, None)
        tracks.tracker.release()
        if joined:
            tracks.tracker.hold(state, base="base")
        tracks.tracker.move(frame)
        said = tracks.settle(frame, frozenset(joined))
    assert set(joined) <= set(said)
    assert ("base" in said) == (len(joined) == 2)
    if "base" in said:
        assert 1e3 * np.linalg.norm((said["base"].T_camera_part - base)[:3, 3]) < 5
        assert said["base"].score >= min(said[name].score for name in joined)


def test_joined_parts_are_absent_once_the_base_is_lost(scene: Scene) -> None:
    """The camera is covered; later the picture comes back."""
    assembly, truth, whole = scene.assembly, scene.truth[-1], scene.frames[-1]
    refind, state = RefindConfig(patience=4), assembly.states[1]
    tracks = PartTracks(assembly, whole.camera, tracker=PROPOSED, refind=refind, turns=TurnConfig())
    proposed = {n: PoseEstimate(n, T, 0.8, "refined") for n, T in truth.items()}
    grey, nothing = np.full_like(whole.rgb, 128), np.zeros(whole.rgb.shape[:2], np.float32)
    covered = replace(whole, rgb=grey, depth=nothing)
    told: list[set[str]] = []
    for i in range(18):
        frame, found = (covered, {}) if 6 <= i < 16 else (whole, proposed)
        tracks.refind(frame, found, {}, None)
        tracks.tracker.release()
        tracks.tracker.hold(state, base="base")
        tracks.tracker.move(frame)
        told.append(set(tracks.settle(frame, frozenset({"block"}))))
    assert told[5] == told[-1] == {"base", "block"}
    assert told[6 + refind.patience : 16] == [set()] * (10 - refind.patience)


def board_over_base(whole: Frame, without: Frame) -> Frame:
    """The frame with a board over all of the base that shows, and around it."""
    assert whole.depth is not None
    assert without.depth is not None
    is_other = without.depth < 0.88
    is_base = (whole.depth < 0.88) & ~is_other
    over = cv2.dilate(is_base.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
    over &= ~is_other
    return replace(
        whole,
        rgb=np.where(over[..., None], np.uint8(100), whole.rgb),
        depth=np.where(over, np.float32(0.3), whole.depth),
    )


def test_a_part_that_is_not_there_is_absent(scene: Scene, toy, detector) -> None:
    alone = replace(scene.assembly, parts={"base": scene.assembly.parts["base"]})
    frames = [scene.only(alone, i) for i in range(FRAMES)]
    detector.answers = {i: (toy.detection("base", T["base"]),) for i, T in enumerate(scene.truth)}
    method = AsdfTrack(AsdfTrackConfig(), detector=detector)
    said = play(method, replace(scene, frames=frames), None)
    assert all(set(p.poses) == {"base"} for p in said)


def nudged(T: Transform, mm: float, degrees: float) -> Transform:
    """The pose moved across the view and turned about the line of sight."""
    moved = T @ transform_from(
        rotation_about(np.array([0, 0, 1.0]), np.deg2rad(degrees)), np.zeros(3)
    )
    moved[0, 3] += mm / 1e3
    return moved


def contour_fits(scene: Scene, config: ContourConfig | None = None) -> ContourFits:
    assembly, camera = scene.assembly, scene.frames[0].camera
    bodies = tracking.load_bodies(assembly)
    return ContourFits(assembly.parts, bodies, camera, config=config or ContourConfig())


def test_contours_end_what_depth_leaves_open(scene: Scene) -> None:
    fits = contour_fits(scene)
    true = scene.truth[ARRIVED]
    frame = scene.frames[ARRIVED]
    found = fits.step(frame, {"base": nudged(true["base"], 4, 5)})
    settled = found["base"].T_camera_part
    off = settled @ np.linalg.inv(true["base"])
    assert found["base"].sure > 0.8
    assert np.linalg.norm((settled - true["base"])[:3, 3]) < 0.0015
    assert rotation_angle(off[:3, :3]) < np.deg2rad(2)
    assert fits.step(replace(frame, depth=None), true) == {}


def test_what_the_picture_does_not_show_is_not_moved(scene: Scene) -> None:
    fits = contour_fits(scene)
    elsewhere = scene.truth[0]["base"].copy()
    elsewhere[:2, 3] += 0.12
    away = fits.step(scene.frames[0], {"base": elsewhere})["base"]
    assert not away.moved
    assert np.array_equal(away.T_camera_part, elsewhere)
    assert away.sure < 0.2
    assert not any(fit.moved for fit in fits.step(hidden(scene.frames[0]), scene.truth[0]).values())
    back = fits.step(scene.frames[0], {"base": scene.truth[0]["base"]})["base"]
    assert back.moved, "colours that were learnt elsewhere are learnt anew"


def test_a_part_that_is_taken_end_for_end_is_turned(scene: Scene) -> None:
    """Several frames must say so; then its other turns are ruled out, the wrong one among them."""
    fits = contour_fits(scene)
    true, R = scene.truth[0]["base"], np.diag([1.0, -1, -1])
    centre = tracking.load_bodies(scene.assembly)["base"].model.centre
    pose = {"base": turned(true, R, centre=centre)}
    off = []
    for frame in scene.frames:
        found = fits.step(frame, pose)["base"]
        pose = {"base": found.T_camera_part}
        off.append(rotation_angle(found.T_camera_part[:3, :3].T @ true[:3, :3]))
    assert min(off[:2]) > 2
    assert off[-1] < 0.1
    for _ in range(10):
        for frame in scene.frames:
            pose = {"base": fits.step(frame, pose)["base"].T_camera_part}
    np.testing.assert_allclose(pose["base"], true, atol=0.02)
    assert not fits.allows(
        scene.frames[0], "base", pose["base"], turned(pose["base"], R, centre=centre)
    )
    assert fits.allows(scene.frames[0], "base", pose["base"], nudged(pose["base"], 1, 2))
    elsewhere = turned(nudged(pose["base"], 90, 0), R, centre=centre)
    assert fits.allows(scene.frames[0], "base", pose["base"], elsewhere)
    # Somebody turned it all the same: nothing is known of that pose, which is turned again.
    pose = {"base": turned(pose["base"], R, centre=centre)}
    for frame in scene.frames:
        pose = {"base": fits.step(frame, pose)["base"].T_camera_part}
    assert rotation_angle(pose["base"][:3, :3].T @ true[:3, :3]) < 0.1


@pytest.mark.parametrize("wrong", [{"a_frame": 0}, {"step": 0.0}, {"step": 0.5, "lead": 0.4}])
def test_turns_out_of_range_are_named(scene: Scene, wrong: dict[str, Any]) -> None:
    with pytest.raises(MethodError, match="turns"):
        contour_fits(scene, ContourConfig(turns=TurnConfig(**wrong)))


def test_what_the_state_holds_is_not_turned(scene: Scene) -> None:
    fits = contour_fits(scene)
    wrong = turned(scene.truth[0]["base"], np.diag([1.0, -1, -1]), centre=np.zeros(3))
    pose = {"base": wrong}
    for frame in scene.frames:
        pose = {"base": fits.step(frame, pose, held=("base",))["base"].T_camera_part}
    assert rotation_angle(pose["base"][:3, :3].T @ wrong[:3, :3]) < 0.5


def test_a_pose_that_rests_is_settled_now_and_then(scene: Scene) -> None:
    config = ContourConfig(times=2, every=4, turns=TurnConfig(enabled=False))
    fits = contour_fits(scene, config)
    pose = {"base": nudged(scene.truth[0]["base"], 2, 1)}
    settled = []
    for frame in scene.frames[:9]:
        found = fits.step(frame, pose)
        pose = {"base": found["base"].T_camera_part}
        settled.append(found["base"].moved)
    assert settled == [True, True, False, False, False, True, False, False, False]


@pytest.fixture
def together(scene: Scene) -> GroupContours:
    bodies = tracking.load_bodies(scene.assembly)
    return GroupContours(bodies, scene.frames[0].camera, base="base", config=ContourConfig())


def test_joined_parts_are_settled_as_one(scene: Scene, together: GroupContours) -> None:
    true, state = scene.truth[ARRIVED], scene.assembly.states[1]
    off = {"base": nudged(true["base"], 3, 3), "block": nudged(true["block"], 4, -6)}
    found = together.step(scene.frames[ARRIVED], off, state)
    for name in ("base", "block"):
        assert np.linalg.norm((found[name] - true[name])[:3, 3]) < 0.002
    T_base_block = np.linalg.inv(found["base"]) @ found["block"]
    np.testing.assert_allclose(T_base_block, state.T_base_part["block"], atol=1e-9)


def test_depth_tells_that_a_part_is_not_where_the_group_has_it(
    scene: Scene, together: GroupContours
) -> None:
    true, state = scene.truth[ARRIVED], scene.assembly.states[1]
    both = {n: T for n, T in true.items() if n != "lid"}
    together.step(scene.frames[ARRIVED], both, state)
    assert min(together.fits.values()) > 0.7
    aside = state.T_base_part["block"] @ transform_from(np.eye(3), np.array([0, 0.03, 0.02]))
    wrong = replace(state, T_base_part={**state.T_base_part, "block": aside})
    there = {"base": true["base"], "block": true["base"] @ aside}
    assert together.step(scene.frames[ARRIVED], there, wrong)
    assert together.fits["base"] > 0.7
    assert together.fits["block"] < 0.3
    together.step(replace(scene.frames[ARRIVED], depth=None), there, wrong)
    assert together.fits == {}


def test_a_joint_is_settled_too(scene: Scene, together: GroupContours) -> None:
    """The block may slide along the base and is said to be 6 mm off."""
    state, true = scene.assembly.states[1], scene.truth[ARRIVED]
    slide = Joint("prismatic", np.array([0.0, 1, 0]), np.zeros(3), slide=(-0.02, 0.02))
    state = replace(state, joints={"block": slide})
    off = true["base"] @ transform_from(np.eye(3), np.array([0, 0.006, 0]))
    off = off @ state.T_base_part["block"]
    found = together.step(scene.frames[ARRIVED], {"base": true["base"], "block": off}, state)
    assert np.linalg.norm((found["block"] - true["block"])[:3, 3]) < 0.002


def test_a_group_that_lies_still_is_settled_now_and_then(
    scene: Scene, together: GroupContours
) -> None:
    true, state, frame = scene.truth[ARRIVED], scene.assembly.states[1], scene.frames[ARRIVED]
    config, told = ContourConfig(), list[dict[str, np.ndarray]]()
    for k in range(config.times + 2 * config.every):
        nearly = {n: nudged(T, 0.4 * (k % 3 - 1), 0) for n, T in true.items() if n != "lid"}
        told.append(together.step(frame, nearly, state))
    same = [all(np.array_equal(now[n], before[n]) for n in now) for before, now in pairwise(told)]
    # Settled at first as often as told to, and then in one frame of so many.
    assert not any(same[: config.times])
    assert same[config.times :] == [
        k % config.every != config.every - 1 for k in range(len(same) - config.times)
    ]
    moved = {n: nudged(T, 5, 0) for n, T in told[-1].items()}
    again = together.step(frame, moved, state)
    assert not np.array_equal(again["base"], told[-1]["base"])


def test_a_group_is_settled_anew_for_a_state_that_has_its_parts_elsewhere(
    scene: Scene, together: GroupContours
) -> None:
    state, frame = scene.assembly.states[1], scene.frames[ARRIVED]
    poses = {n: T for n, T in scene.truth[ARRIVED].items() if n != "lid"}
    for _ in range(ContourConfig().times + 1):
        poses = together.step(frame, poses, state)
    assert np.array_equal(together.step(frame, poses, state)["block"], poses["block"])
    slide = Joint("prismatic", np.array([0.0, 1, 0]), np.zeros(3), slide=(-0.02, 0.02))
    beside = state.T_base_part["block"] @ transform_from(np.eye(3), np.array([0, 0.004, 0]))
    places = {**state.T_base_part, "block": beside}
    for other in (
        replace(state, joints={"block": slide}),
        replace(state, T_base_part=places, joints={"block": slide}),
    ):
        again = together.step(frame, poses, other)
        assert again
        assert not np.array_equal(again["block"], poses["block"])


def test_a_group_that_is_not_there_stays_as_it_was(scene: Scene, together: GroupContours) -> None:
    state, true = scene.assembly.states[1], scene.truth[ARRIVED]
    aside = {n: transform_from(np.eye(3), np.array([0.1, 0.1, 0])) @ T for n, T in true.items()}
    found = together.step(scene.frames[ARRIVED], aside, state)
    for name, T in found.items():
        assert np.linalg.norm((T - aside[name])[:3, 3]) < 0.012
    assert together.step(hidden(scene.frames[ARRIVED]), true, state) == {}
    assert together.step(replace(scene.frames[ARRIVED], depth=None), true, state) == {}
    assert together.step(scene.frames[ARRIVED], {"block": true["block"]}, state) == {}
