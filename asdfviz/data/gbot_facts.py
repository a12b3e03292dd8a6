"""What the paper's assemblies do not say of themselves: symmetries, freedoms, errors, colours.

The GBOT data names parts and poses only. Symmetries were found by turning each mesh onto itself
(95 % of the surface within 2 % of the box's diagonal, 2.5 % for head plate and nut); freedoms follow from
bores, threads and rails; errors are mistakes that the parts allow. Millimetres and degrees, in
the base part's frame unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal


@dataclass(frozen=True)
class Turns:
    """A symmetry axis through the origin of the part's frame; folds = 0 means any turn."""

    axis: Literal["x", "y", "z"]
    folds: int = 0


@dataclass(frozen=True)
class Freedom:
    """A joint in the base part's frame."""

    kind: Literal["prismatic", "revolute", "cylindrical", "ball"]
    axis: tuple[float, float, float]
    origin_mm: tuple[float, float, float]
    slide_mm: tuple[float, float] = (0.0, 0.0)
    turn_deg: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Mistake:
    """An error state: the parts that are joined, and those of them that sit wrong."""

    name: str
    joined: tuple[str, ...]
    flipped: dict[str, Literal["x", "y", "z"]] = field(
        default_factory=dict[str, Literal["x", "y", "z"]]
    )
    """Part: axis of its own frame, through the middle of its box, that it is turned 180 deg about."""
    shifted_mm: dict[str, tuple[float, float, float]] = field(
        default_factory=dict[str, tuple[float, float, float]]
    )
    """Part: how far it is moved too, base frame."""


@dataclass(frozen=True)
class Facts:
    """All that is added to one of the paper's assemblies."""

    name: str
    """Folder among the models."""
    title: str
    symmetries: dict[str, Turns]
    joints: dict[str, Freedom]
    mistakes: tuple[Mistake, ...] = ()
    colors: dict[str, tuple[int, int, int]] = field(default_factory=dict[str, tuple[int, int, int]])
    """sRGB of the printed parts; otherwise the median of the mesh's vertex colours."""


_BLUE, _BLACK, _GREY, _WHITE = (20, 90, 170), (25, 25, 28), (132, 132, 132), (235, 235, 232)

_BALL = Freedom("ball", (-1.0, 0.0, 0.0), (-86.55, -0.7, 20.0), turn_deg=(-20.0, 20.0))
_CLAMP_AXIS = (0.0, -0.9, 20.0)
_JAW = Freedom("prismatic", (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), slide_mm=(-20.0, 50.0))

CORNER_CLAMP = Facts(
    name="gbot_cornerclamp",
    title="GBOT corner clamp",
    symmetries={"Corner_Clamp_Bolt": Turns("z")},
    joints={
        "Corner_Clamp_Jaw": Freedom(
            "prismatic", (1.0, 0.0, 0.0), (0.0, 0.13, 0.19), slide_mm=(-20.0, 20.0)
        ),
        "Corner_Clamp_Bolt": Freedom(
            "cylindrical",
            (1.0, 0.0, 0.0),
            (0.0, 0.13, 0.19),
            slide_mm=(-20.0, 20.0),
            turn_deg=(-180.0, 180.0),
        ),
    },
    mistakes=(
        Mistake(
            "jaw_reversed",
            ("Corner_Clamp_Base", "Corner_Clamp_Jaw"),
            {"Corner_Clamp_Jaw": "z"},
            # Its back would stand in the corner posts otherwise.
            {"Corner_Clamp_Jaw": (-25.0, 0.0, 0.0)},
        ),
        Mistake("bolt_before_jaw", ("Corner_Clamp_Base", "Corner_Clamp_Bolt")),
    ),
)

NANO_VISE = Facts(
    name="gbot_nanovise",
    title="GBOT NanoVise",
    symmetries={
        "NanoViseV2_CLAMP_BALLJOINT": Turns("z"),
        "NanoViseV2_CLAMP_HEADPLATE": Turns("z"),
        "NanoViseV2_CLAMP_NUT": Turns("z"),
        "NanoViseV2_CLAMP_SCREW": Turns("z"),
        "NanoViseV2_Connector": Turns("y"),
        "NanoViseV2_VISE_SCREW": Turns("z"),
    },
    joints={
        # Screw and head plate share axis and travel: they move as one.
        "NanoViseV2_CLAMP_SCREW": Freedom(
            "cylindrical",
            (1.0, 0.0, 0.0),
            _CLAMP_AXIS,
            slide_mm=(-25.0, 20.0),
            turn_deg=(-180.0, 180.0),
        ),
        "NanoViseV2_CLAMP_HEADPLATE": Freedom(
            "cylindrical",
            (1.0, 0.0, 0.0),
            _CLAMP_AXIS,
            slide_mm=(-25.0, 20.0),
            turn_deg=(-180.0, 180.0),
        ),
        "NanoViseV2_CLAMP_NUT": Freedom(
            "cylindrical",
            (1.0, 0.0, 0.0),
            _CLAMP_AXIS,
            slide_mm=(-2.0, 2.0),
            turn_deg=(-180.0, 180.0),
        ),
        # Everything on the ball turns with it.
        "NanoViseV2_CLAMP_BALLJOINT": _BALL,
        "NanoViseV2_VISE_BASE": _BALL,
        "NanoViseV2_Connector": _BALL,
        "NanoViseV2_VISE_SLIDER": _BALL,
        "NanoViseV2_VISE_SCREW": _BALL,
    },
    mistakes=(
        Mistake(
            "headplate_missing",
            ("NanoViseV2_CLAMP_BASE", "NanoViseV2_CLAMP_SCREW", "NanoViseV2_CLAMP_BALLJOINT"),
        ),
        Mistake(
            "slider_reversed",
            (
                "NanoViseV2_CLAMP_BASE",
                "NanoViseV2_CLAMP_SCREW",
                "NanoViseV2_CLAMP_HEADPLATE",
                "NanoViseV2_CLAMP_BALLJOINT",
                "NanoViseV2_CLAMP_NUT",
                "NanoViseV2_VISE_BASE",
                "NanoViseV2_Connector",
                "NanoViseV2_VISE_SLIDER",
            ),
            {"NanoViseV2_VISE_SLIDER": "z"},
        ),
    ),
    colors={
        "NanoViseV2_CLAMP_BALLJOINT": _BLACK,
        "NanoViseV2_CLAMP_BASE": _BLUE,
        "NanoViseV2_CLAMP_HEADPLATE": _BLACK,
        "NanoViseV2_CLAMP_NUT": _GREY,
        "NanoViseV2_CLAMP_SCREW": _BLACK,
        "NanoViseV2_Connector": _BLUE,
        "NanoViseV2_VISE_BASE": _BLUE,
        "NanoViseV2_VISE_SCREW": _WHITE,
        "NanoViseV2_VISE_SLIDER": _GREY,
    },
)

GEARED_CALIPER = Facts(
    name="gbot_gearedcaliper",
    title="GBOT geared caliper",
    symmetries={
        "Caliper_Gear_1": Turns("y", 10),
        "Caliper_Gear_2": Turns("y", 5),
        "Caliper_Roller": Turns("z", 15),
    },
    joints={
        "Caliper_Fix": Freedom(
            "prismatic", (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), slide_mm=(-40.0, 28.0)
        ),
        # The roller sits on the shaft of gear 1.
        "Caliper_Gear_1": Freedom(
            "revolute", (0.0, 0.0, 1.0), (-9.66, 15.8, 0.0), turn_deg=(-180.0, 180.0)
        ),
        "Caliper_Roller": Freedom(
            "revolute", (0.0, 0.0, 1.0), (-9.66, 15.8, 0.0), turn_deg=(-180.0, 180.0)
        ),
        "Caliper_Gear_2": Freedom(
            "revolute", (0.0, 0.0, 1.0), (16.07, 15.83, 0.0), turn_deg=(-180.0, 180.0)
        ),
    },
    mistakes=(
        Mistake("fix_before_gears", ("Caliper_Move_Bottom", "Caliper_Fix")),
        Mistake(
            "cover_before_fix",
            (
                "Caliper_Move_Bottom",
                "Caliper_Gear_1",
                "Caliper_Gear_2",
                "Caliper_Move_Top_Vernier",
            ),
        ),
    ),
)

SCREW_CLAMP = Facts(
    name="gbot_screwclamp",
    title="GBOT hand screw clamp",
    symmetries={
        "HS_Knob1": Turns("z", 4),
        "HS_Knob2": Turns("z", 4),
        "HS_Thread1": Turns("y", 2),
        "HS_Thread2": Turns("y", 2),
    },
    joints={
        "HS_Pad": Freedom(
            "revolute", (0.0, 1.0, 0.0), (-79.27, 0.0, 16.97), turn_deg=(-45.0, 39.0)
        ),
        "HS_Pin": Freedom(
            "revolute", (0.0, 1.0, 0.0), (-79.27, 0.0, 16.97), turn_deg=(-180.0, 180.0)
        ),
        "HS_Knob1": Freedom(
            "revolute", (0.0, 0.0, 1.0), (-2.02, 0.0, 0.0), turn_deg=(-180.0, 180.0)
        ),
        "HS_Knob2": Freedom(
            "revolute", (0.0, 0.0, 1.0), (71.64, 0.0, 0.0), turn_deg=(-180.0, 180.0)
        ),
        # The second jaw and all that hangs on it move with the spindles.
        "HS_Thread1": _JAW,
        "HS_Thread2": _JAW,
        "HS_Jaw2": _JAW,
        "HS_Pin-Copy": _JAW,
        "HS_Pin-Copy1": _JAW,
        "HS_Pin-Copy2": _JAW,
        "HS_Pad-Copy": _JAW,
    },
)

FACTS = {
    "NanoVise": NANO_VISE,
    "CornerClamp": CORNER_CLAMP,
    "GearedCaliper": GEARED_CALIPER,
    "HandScrewClamp": SCREW_CLAMP,
}
"""By the assembly's name in the description of the paper's data."""
