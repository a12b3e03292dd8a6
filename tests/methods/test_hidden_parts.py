"""How sure parts are told that the state holds and that something hides."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Camera, Frame, Mesh, PoseEstimate
from asdfviz.errors import MethodError
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.at_rest import AtRest
from asdfviz.methods.at_rest_config import AtRestConfig
from asdfviz.methods.hidden_parts import sure_as_it_lay, sure_as_the_base
from asdfviz.methods.refinding import RefindConfig
from asdfviz.methods.track_memory import Track

CAMERA = Camera(np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]]), 320, 240)
FRAME = Frame(0, 0.0, np.zeros((240, 320, 3), np.uint8), None, CAMERA)


def square(half: float) -> Mesh:
    """Across the line of sight, metres."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half
    return Mesh(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32))


MESHES = {"base": square(0.05), "part": square(0.02)}


def posed(name: str, score: float, x: float, z: float) -> PoseEstimate:
    stage = "tracked" if name == "base" else "group"
    return PoseEstimate(name, transform_from(np.eye(3), np.array([x, 0.0, z])), score, stage)


def told(
    track: Track, *, share: float = 0.8, x: float = 0.0, z: float = 0.49, base: float = 0.9
) -> float:
    """The score of a part at 0.02 by itself, with its base half a metre off."""
    poses = {"base": posed("base", base, 0.0, 0.5), "part": posed("part", 0.02, x, z)}
    tracks = {"base": Track(np.eye(4)), "part": track}
    said = sure_as_the_base(poses, tracks, FRAME, meshes=MESHES, base="base", share=share)
    assert said["base"] is poses["base"]
    return said["part"].score


def test_a_hidden_part_that_the_state_holds_is_almost_as_sure_as_its_base() -> None:
    hidden = Track(np.eye(4), unsure=4, joined=True)
    assert told(hidden) == pytest.approx(0.72)
    assert told(hidden, share=0.0) == 0.02
    assert told(hidden, base=0.01) == 0.02


@pytest.mark.parametrize(
    "track",
    [
        Track(np.eye(4), unsure=4),
        Track(np.eye(4), unsure=4, missing=1, joined=True),
        Track(np.eye(4), joined=True),
    ],
    ids=["free", "seen elsewhere", "sure by itself"],
)
def test_all_others_are_as_sure_as_what_is_seen_of_them(track: Track) -> None:
    assert told(track) == 0.02


def test_a_part_close_behind_another_is_hidden_too_though_depth_does_not_tell() -> None:
    missing = Track(np.eye(4), unsure=4, missing=4, joined=True)
    assert told(missing, z=0.505) == pytest.approx(0.72)
    assert told(missing, z=0.505, x=0.05) == 0.02, "half of it shows"
    assert told(missing, z=0.505, x=3.0) == 0.02, "out of the picture"


def test_without_the_base_all_stays() -> None:
    alone = {"part": posed("part", 0.02, 0.0, 0.5)}
    tracks = {"part": Track(np.eye(4), unsure=1, joined=True)}
    assert sure_as_the_base(alone, tracks, FRAME, meshes=MESHES, base="base", share=0.8) == alone


LYING = {
    name: transform_from(np.eye(3), np.array([x, 0.0, 0.6]))
    for name, x in (("body", 0.0), ("slider", 0.15), ("pad", -0.15))
}


def lain(track: Track, *, frames: int = 8, moved: float = 0.0, score: float = 0.02) -> float:
    """The score of a pad that lay there for so many frames, and is told to be so far off now."""
    rest = AtRest(load_assembly("vise"), config=AtRestConfig())
    for _ in range(frames):
        rest.see({n: PoseEstimate(n, T, 0.9, "tracked") for n, T in LYING.items()}, joined=())
    rest.see({}, joined=())  # nothing is seen of anything
    T_now = LYING["pad"] @ transform_from(np.eye(3), np.array([moved, 0.0, 0.0]))
    poses = {"pad": PoseEstimate("pad", T_now, score, "tracked")}
    return sure_as_it_lay(poses, {"pad": track}, rest, least=0.3)["pad"].score


def test_what_is_hidden_where_it_lay_still_is_not_given_up() -> None:
    hidden = Track(np.eye(4), unsure=4)
    assert lain(hidden) == 0.3
    assert lain(hidden, score=0.5) == 0.5
    assert lain(hidden, moved=0.012) == 0.02, "it was taken along"
    assert lain(hidden, frames=3) == 0.02, "too seldom seen there"
    assert lain(Track(np.eye(4))) == 0.02, "sure by itself"
    assert lain(Track(np.eye(4), unsure=4, missing=1)) == 0.02, "nothing hides it"
    assert lain(Track(np.eye(4), unsure=4, joined=True)) == 0.02, "the base tells"


@pytest.mark.parametrize("share", [-0.1, 1.1, float("nan")])
def test_a_share_that_is_none_is_refused(share: float) -> None:
    with pytest.raises(MethodError, match="hidden"):
        RefindConfig(hidden=share)
    with pytest.raises(MethodError, match="hidden_lain"):
        RefindConfig(hidden_lain=share)
