"""How a sequence is played and recorded, and the conditions under which GBOT's sets were."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeAlias

from asdfviz.errors import InputError
from asdfviz.synth.bop_writer import require_size
from asdfviz.synth.motion import Pace
from asdfviz.synth.photo_grounds import Photos

Condition: TypeAlias = Literal["table", "normal", "dynamic", "hand", "blur"]
"""`table`: hands assemble (the paper's recordings). `normal`: parts move into place by themselves
under steady light. `dynamic`: the same while the lights travel. `hand`: hands hide much. `blur`:
moving parts and a moving camera with a long shutter. The last four as in GBOT (Li et al., 2024)."""


@dataclass(frozen=True, slots=True)
class SequenceConfig:
    """How a sequence is played and recorded."""

    width: int = 640
    """Pixels."""
    height: int = 360
    """Pixels."""
    fps: float = 10.0
    """3 to 30; below 10, people work slower, so that parts move 25 mm and 12 degrees a frame at most."""
    frames: int | None = None
    """Frames in all; slower movements fill them. None for as many as the pace needs. Fewer than held
    parts need at their limits are not possible: then that is how many there are."""
    frames_per_state: int | None = None
    """The same for each state, under the same condition; None for as many as the pace needs."""
    every: int = 1
    """Only each so-manieth frame is drawn, from one of the first that the seed chooses: for training,
    where what looks alike teaches little."""
    condition: Condition = "table"
    """A name for the record; `condition_config` sets what belongs to it."""
    hands: bool = True
    """Hands carry the parts; otherwise they move by themselves."""
    covering_hand: bool = False
    """Further hands hold the base and hover over the assembly."""
    error: bool | str = True
    """Make one error, if the assembly knows any and `frames` leaves the time, and correct it; a name
    chooses which."""
    unlisted: bool = False
    """Hold one part to a place 5 to 30 mm and 10 to 40 degrees off, which no state lists."""
    distance: tuple[float, float] = (0.48, 0.62)
    """Camera to table, metres; it goes farther where the parts need the room."""
    tilt: tuple[float, float] = (0.0, 0.22)
    """Angle between the optical axis and the vertical, radians."""
    distractors: int = 3
    """At most."""
    theatre: float = 0.7
    """Probability of the blue drape."""
    photos: Photos = field(default_factory=Photos)
    """Of the user's own table, which most sequences then show."""
    light_speed: float = 0.0
    """How fast the lights travel round the table, radians a second."""
    sway: float = 0.0
    """Amplitude of the camera's movement, metres."""
    exposures: int = 1
    """Pictures that are averaged over the time of the shutter; 1 smears hands and held parts instead."""
    depth_step_mm: int = 1
    """Depth is rounded to multiples of this, millimetres; 2 halves the size of the files."""
    shift: bool = False
    """Depth is misregistered against colour, alike in all frames, as in the paper's real frames."""
    shutter: float = 0.3
    """Share of the time between frames in which the shutter is open."""
    jpeg_quality: int = 88
    pace: Pace = field(default_factory=Pace)


_SETTINGS: dict[str, dict[str, Any]] = {
    "table": {},
    "normal": {"hands": False},
    "dynamic": {"hands": False, "light_speed": 0.9},
    "hand": {"covering_hand": True},
    "blur": {"hands": False, "sway": 0.03, "exposures": 5, "shutter": 0.9},
}


def condition_config(name: str, **overrides: Any) -> SequenceConfig:
    """The settings of one of the conditions, some of them changed.

    Raises:
        InputError: there is no such condition.
    """
    if name not in _SETTINGS:
        raise InputError(f"no condition '{name}', use one of {', '.join(_SETTINGS)}")
    settings = {"condition": name, **_SETTINGS[name], **overrides}
    return replace(SequenceConfig(), **settings)


def check_config(config: SequenceConfig) -> None:
    """Refuse sizes, rates and counts that make no sequence.

    Raises:
        InputError: with the value and what would be right.
    """
    require_size(config.width, config.height)
    if not 3 <= config.fps <= 30:
        raise InputError(f"{config.fps} frames a second: use 3 to 30")
    counts = {
        "frames": config.frames,
        "frames_per_state": config.frames_per_state,
        "every": config.every,
    }
    for name, count in counts.items():
        if count is not None and count < 1:
            raise InputError(f"{name} is {count}, use 1 or more")
    if config.frames is not None and config.frames_per_state is not None:
        raise InputError(
            f"frames is {config.frames} and frames_per_state {config.frames_per_state}, use one of them"
        )
    if config.exposures < 1 or not 0 <= config.shutter <= 1:
        raise InputError(
            f"{config.exposures} exposures with a shutter of {config.shutter}: use 1 or more and 0 to 1"
        )
