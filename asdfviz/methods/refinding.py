"""Where a tracked part may be in the next frame: the starts from which the tracker looks for it.

From where it was, from where it was heading, from where the detector sees it, and from where a state
of the assembly has it. A part that is lost, or new, is looked for in all its quarter turns, since a
detector finds places long before it tells rotations apart.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from asdfviz.datatypes import Assembly, PoseEstimate, State
from asdfviz.errors import MethodError
from asdfviz.geometry.shapes import Intrinsics, Rotation, Transform, Vector
from asdfviz.geometry.transforms import (
    apply_to_point,
    inverse,
    orthonormalized,
    rotation_about,
    rotation_angle,
    transform_from,
)
from asdfviz.methods.disowned import DisownedConfig
from asdfviz.methods.held_colors import HeldConfig
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.place_support import SupportConfig
from asdfviz.methods.track_memory import Track
from asdfviz.state.joints import nearest_in_joint, spread_of
from asdfviz.track.starts import Trial

SAME = 0.005
"""Starts nearer to each other than this (metres) and SAME_ANGLE are one."""
SAME_ANGLE = 0.1
"""Radians."""


@dataclass(frozen=True)
class RefindConfig:
    """How starts are chosen and compared; scores are those of `Trial.score`, 0 to 2."""

    margin: float = 0.15
    """A start that jumps must fit better than those that carry on by this."""
    looks: float = 0.05
    """Where it is turned otherwise in about the same place, only if it looks more like that by so much
    (`DrawnConfig`): a part is not turned end for end from frame to frame;"""
    plainly: float = 0.25
    """and if by so much, whatever its fit. Of 144 pairs of such poses in four sequences, one of them right,
    looks told 97 % in single frames, the tracker's fit, with the networks' preference, 64 %, and no wrong
    one was ahead by more than 0.1."""
    turns: int = 2
    """Quarter turns of a sure part that are tried a frame, in turn: it may sit in a wrong one. Parts
    that the state joins, or that are hidden, are left in peace."""
    lead: float = 0.45
    """Sum of values by which a pose that fits a little better must be ahead over frames."""
    step: float = 0.2
    """No frame counts for more than this in it: a single one may deceive."""
    rotation_weight: float = 0.5
    """Of the crop network's preference for a rotation, 0 to 1, where all of the part is seen."""
    box_weight: float = 0.2
    """Of a detected box of score 1 that has the part's centre inside."""
    support: SupportConfig = field(default_factory=SupportConfig)
    """When the detector is believed that a part is elsewhere."""
    missing: int = 3
    """A part that did not fit in so many frames in a row, though nothing hid it, begins anew"""
    anew: float = 0.25
    """where the detector has it with at least this score, 0 to 1,"""
    fits_better: float = 0.3
    """if so much more of it fits depth closely there than where it is tracked, 0 to 1."""
    disowned: DisownedConfig = field(default_factory=DisownedConfig)
    """When the networks are believed that it is not as it is tracked."""
    seen: float = 0.7
    """Visible share from which turns are tried."""
    rough_rounds: int = 3
    """Correspondence searches by which starts that jump are compared first."""
    kept: int = 2
    """So many of them are then settled in full,"""
    doubt: float = 0.3
    """if they are behind the best that carries on by less than this."""
    hidden_below: float = 0.5
    """Visible share below which a part is not lost but hidden: it is taken to stay where it was,"""
    patience: int = 15
    """for so many frames."""
    hidden: float = 0.8
    """As sure as the base, times this, is a part that the state holds and that is hidden, 0 to 1. Behind
    rendered hands 385 of 689 such poses are right; of a screw clamp's parts the base is above 0.68 in
    nine of ten that are right, and below 0.03 in three of four that are wrong."""
    hidden_lain: float = 0.3
    """As sure at least is a part that is hidden where it lay still, 0 to 1. Behind rendered hands two of
    three such poses are right."""
    held: HeldConfig = field(default_factory=HeldConfig)
    """When parts that the state holds have their colours learnt anew."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not (0 <= self.hidden <= 1 and 0 <= self.hidden_lain <= 1):
            raise MethodError(
                f"refind.hidden is {self.hidden:g}, hidden_lain {self.hidden_lain:g}: use 0 to 1"
            )


def quarter_turns() -> tuple[Rotation, ...]:
    """The 24 rotations of a cube, identity first."""
    found: list[Rotation] = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.zeros((3, 3))
            R[range(3), order] = signs
            if np.linalg.det(R) > 0:
                found.append(R)
    return tuple(sorted(found, key=lambda R: -float(np.trace(R))))


QUARTER_TURNS = quarter_turns()
TILTS = tuple(
    rotation_about(np.array(axis), np.pi / 4) if any(axis) else np.eye(3)
    for axis in ((0.0, 0, 0), (1.0, 1, 1), (1.0, 0, 0), (0.0, 1, 0), (0.0, 0, 1))
)
"""Turned by these first, the quarter turns fall between each other."""


def turned(T_camera_part: Transform, R: Rotation, *, centre: Vector) -> Transform:
    """The pose with the part turned in its own axes about a point of it."""
    return moved_to(
        transform_from(T_camera_part[:3, :3] @ R, np.zeros(3)),
        apply_to_point(T_camera_part, centre),
        centre=centre,
    )


def moved_to(T_camera_part: Transform, place: Vector, *, centre: Vector) -> Transform:
    """The pose with that point of the part at a place in the camera frame."""
    R = T_camera_part[:3, :3]
    return transform_from(R, place - R @ centre)


def heading(T_before: Transform, T_now: Transform) -> Transform:
    """Where a part goes if it moves on as it did from the frame before (T_camera_part)."""
    return orthonormalized(T_now @ inverse(T_before) @ T_now)


def carried_on(track: Track, proposal: PoseEstimate | None, *, centre: Vector) -> list[Transform]:
    """Starts that carry on: at rest, moving on, and turned as before where the detector is.

    Where others have an unsure part may be wrong, so it is also looked for where it last surely was.
    """
    starts = [track.T_now]
    if track.unsure and track.T_sure is not None:
        starts.append(track.T_sure)
    if track.T_expected is not None:
        starts.append(track.T_expected)
    if track.T_before is not None:
        starts.append(heading(track.T_before, track.T_now))
    if proposal is not None:
        place = apply_to_point(proposal.T_camera_part, centre)
        starts.append(moved_to(track.T_now, place, centre=centre))
    return distinct(starts, centre=centre)


def jumps(
    track: Track,
    proposal: PoseEstimate | None,
    look: LookedAt | None,
    *,
    centre: Vector,
    frames: int,
    config: RefindConfig,
) -> list[Transform]:
    """Starts that jump: as the detector sees the part, and quarter turns.

    While a part is searched for, the turns begin at another tilt in every frame, so that they come to
    lie ever denser.

    Args:
        track: what is remembered of the part.
        proposal: the detector's pose, if it has one,
        look: and what that came from.
        centre: of the part, in its frame.
        frames: how many there were so far.
        config: how many turns of a sure part are tried.
    """
    starts: list[Transform] = []
    searching = track.is_new or track.unsure > 0
    tilt = TILTS[(track.age + track.unsure) % len(TILTS) if searching else 0]
    if proposal is not None:
        T = proposal.T_camera_part
        starts.append(T)
        starts += [one.T_camera_part for one in look.settled[1:]] if look is not None else []
        if searching:
            starts += [turned(T, R @ tilt, centre=centre) for R in QUARTER_TURNS]
    others = QUARTER_TURNS[1:]
    count = len(others) if track.is_new else config.turns * track.explore
    turns = [others[(frames * count + k) % len(others)] for k in range(count)]
    return starts + [turned(track.T_now, R @ tilt, centre=centre) for R in turns]


def found_elsewhere(
    track: Track,
    proposal: PoseEstimate,
    score: float,
    *,
    centre: Vector,
    diameter: float,
    config: SupportConfig,
) -> bool:
    """Whether the detector, now by a box of this score, found a part far from its track for long enough."""
    return track.support.hear(
        apply_to_point(track.T_now, centre),
        apply_to_point(proposal.T_camera_part, centre),
        score=score,
        diameter=diameter,
        is_sure=not track.unsure,
        config=config,
    )


def is_mistaken(
    track: Track,
    proposal: PoseEstimate,
    settle: Callable[[Sequence[Transform]], list[Trial]],
    *,
    config: RefindConfig,
) -> bool:
    """Whether a part that did not fit for long fits depth better where the detector has it.

    Colours that were learnt on something else speak against every right pose.
    """
    if track.missing < config.missing or proposal.score < config.anew:
        return False
    now, seen = settle([track.T_now, proposal.T_camera_part])
    return seen.sharp - now.sharp > config.fits_better


def places_in(
    states: Iterable[State],
    name: str,
    T_camera_base: Transform,
    T_camera_part: Transform,
    *,
    assembly: Assembly,
    centre: Vector,
) -> list[Transform]:
    """Where the states join a part to the base, as near to the given pose as its joint allows."""
    T_base_part = inverse(T_camera_base) @ T_camera_part
    found: list[Transform] = []
    for state in states:
        if name == assembly.base or name not in state.T_base_part:
            continue
        T_nominal, joint = state.T_base_part[name], state.joints.get(name)
        if joint is not None:
            spread = spread_of(assembly.parts[name])
            T_nominal = nearest_in_joint(
                T_base_part, T_nominal, joint, center_part=centre, spread=spread
            )
        found.append(T_camera_base @ T_nominal)
    return found


def distinct(
    starts: Sequence[Transform], *, centre: Vector, known: Sequence[Transform] = ()
) -> list[Transform]:
    """The starts without those that are near to an earlier one, or to one that is known."""
    kept = list(known)
    for T in starts:
        if not any(_same(T, other, centre) for other in kept):
            kept.append(T)
    return kept[len(known) :]


def _same(T_a: Transform, T_b: Transform, centre: Vector) -> bool:
    apart = float(np.linalg.norm((T_a - T_b)[:3] @ np.append(centre, 1.0)))
    return apart < SAME and rotation_angle(T_a[:3, :3].T @ T_b[:3, :3]) < SAME_ANGLE


def preferred(
    trial: Trial, *, look: LookedAt | None, K: Intrinsics, centre: Vector, config: RefindConfig
) -> float:
    """How a trial fits, and what the networks think of its rotation and its place.

    The tracker's colours and depth hardly tell a part from the same part turned round.

    Args:
        trial: of a part.
        look: what the crop network said of it in this frame; None: nothing.
        K: of the frame.
        centre: of the part, in its frame.
        config: the weights.
    """
    if look is None:
        return trial.sharp_score
    T = trial.T_camera_part
    x, y, z = K @ apply_to_point(T, centre)
    x0, y0, x1, y1 = look.detection.box_xyxy
    is_inside = z > 0 and x0 * z <= x <= x1 * z and y0 * z <= y <= y1 * z
    liked = config.rotation_weight * trial.evidence.visible * look.likely(T)
    return trial.sharp_score + liked + config.box_weight * look.detection.score * is_inside
