"""Our own geared caliper: a rack on the rule, two gears and a thumb roller that drives them; mm.

The carriage is the base: the rule slides in it along x while pinion and wheel turn on its posts.
"""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from asdfviz.datatypes import Joint
from asdfviz.geometry.shapes import Transform
from asdfviz.synth.own_design import Design, Piece, Step, freedom, turned_alike
from asdfviz.synth.own_shapes import (
    box,
    cone,
    cylinder,
    gear,
    outline_of,
    placed,
    polar_prism,
    prism,
    rack,
    rounded_box,
)

MODULE, PINION_TEETH, WHEEL_TEETH = 2.5, 12, 16
PITCH = np.pi * MODULE
HALF_RULE = 11.0
"""From the rule's middle to the tips of the rack, and to the plain edge."""
PITCH_LINE = -HALF_RULE + 0.8 * MODULE
PINION_RADIUS, WHEEL_RADIUS = MODULE * PINION_TEETH / 2, MODULE * WHEEL_TEETH / 2
PINION = np.array([0.0, PITCH_LINE - PINION_RADIUS])
_DOWN_RIGHT = np.deg2rad(-30.0)
"""Direction from pinion to wheel: four teeth of the pinion from the rack, so a tooth lies on it."""
WHEEL = PINION + (PINION_RADIUS + WHEEL_RADIUS) * np.array(
    [np.cos(_DOWN_RIGHT), np.sin(_DOWN_RIGHT)]
)
FLOOR, RULE_BOTTOM, RULE_TOP = 4.0, 4.2, 9.2
GEAR_BOTTOM, GEAR_TOP = 4.4, 9.4
COVER_BOTTOM, COVER_TOP = 10.0, 13.2
OPENING = 32.0
"""Between the beaks in the nominal pose."""
TRAVEL = (-34.0, 26.0)
"""Of the rule in the carriage along x; the lower end opens the beaks."""
BEAK_FACE = -24.0
"""x of the carriage's measuring face."""
PEGS = ((-19.0, 15.2), (47.0, 15.2), (-17.5, -45.0))
"""Where the cover is plugged onto the carriage."""


def design() -> Design:
    """The caliper in five states and three mistakes."""
    return Design(
        "Geared caliper",
        (
            Piece(("carriage",), carriage_solid(), (38, 44, 56)),
            Piece(("rule",), rule_solid(), (238, 236, 226)),
            Piece(("pinion",), pinion_solid(), (238, 158, 24), turned_alike(PINION_TEETH)),
            Piece(("wheel",), wheel_solid(), (196, 44, 40), turned_alike(2)),
            Piece(("cover",), cover_solid(), (34, 120, 168)),
            Piece(("roller",), roller_solid(), (126, 190, 60)),
        ),
        _steps(),
    )


def _steps() -> tuple[Step, ...]:
    rule = {"rule": rule_pose()}
    gears = {"pinion": pinion_pose(), "wheel": wheel_pose()}
    cover = {"cover": placed((0, 0, COVER_BOTTOM), x=(1, 0, 0), z=(0, 0, 1))}
    crank = wheel_pose()
    crank[2, 3] = COVER_TOP + 0.4
    roller = {"roller": crank}
    slide = freedom("prismatic", (1, 0, 0), (0, 0, 0), slide_mm=TRAVEL, link="rack")
    turns = {"pinion": _turn(PINION, PINION_RADIUS, -1), "wheel": _turn(WHEEL, WHEEL_RADIUS, 1)}
    knob = {"roller": turns["wheel"]}
    stuck = freedom("prismatic", (1, 0, 0), (0, 0, 0), slide_mm=(0.0, 30.0))
    return (
        Step("carriage"),
        Step("rule", rule, {"rule": slide}),
        Step("gears", gears, turns),
        Step("cover", cover),
        Step("roller", roller, knob),
        Step("rule_reversed", {"rule": reversed_rule_pose()}, {"rule": stuck}, after="carriage"),
        Step("gears_missing", cover, after="rule"),
        Step("cover_missing", roller, knob, after="gears"),
    )


def _turn(axle: np.ndarray, radius: float, sense: int) -> Joint:
    """A gear's turn that goes with the rule's travel, about z or, against it, about -z."""
    degrees = np.rad2deg(np.array(TRAVEL) / radius)
    return freedom(
        "revolute",
        (0, 0, sense),
        (*axle, 0),
        turn_deg=(float(degrees[0]), float(degrees[1])),
        link="rack",
    )


def rule_pose() -> Transform:
    """The rule in the carriage, opened by OPENING."""
    return placed((BEAK_FACE - OPENING, 0, RULE_BOTTOM), x=(1, 0, 0), z=(0, 0, 1))


def reversed_rule_pose() -> Transform:
    """The rule put in from the other side: beak to the right, rack away from the gears."""
    return placed((58, 0, RULE_BOTTOM), x=(-1, 0, 0), z=(0, 0, 1))


def pinion_pose() -> Transform:
    """A tooth in the space of the rack that stands over the pinion's axle."""
    return placed((*PINION, GEAR_BOTTOM), x=(0, 1, 0), z=(0, 0, 1))


def wheel_pose() -> Transform:
    """A space of the wheel on the line to the pinion."""
    angle = _DOWN_RIGHT + np.pi - np.pi / WHEEL_TEETH
    return placed((*WHEEL, GEAR_BOTTOM), x=(np.cos(angle), np.sin(angle), 0), z=(0, 0, 1))


def carriage_solid() -> Manifold:
    """Frame: x along the rule, z up from the underside, origin under the rule's middle line."""
    plate = CrossSection.batch_hull(
        [
            outline_of([(-21, 17), (49, 17)], radius=3),
            outline_of([(-18, -46)], radius=6),
            outline_of([(float(WHEEL[0]), float(WHEEL[1]))], radius=15),
        ]
    )
    body = plate.extrude(FLOOR)
    body += rounded_box((-24, 52), (HALF_RULE + 0.3, 20), (0, 9.8), radius=2)
    for left, right in ((-24, -16), (40, 52)):
        body += rounded_box((left, right), (-18.5, -HALF_RULE - 0.3), (0, 9.8), radius=2)
    beak = prism([(-24, 18), (-24, 56), (-21, 56), (-11, 42), (-9, 30), (-2, 18)], RULE_TOP)
    body += beak + cylinder(6, 0, COVER_BOTTOM - 0.2, at=PEGS[2])
    for peg in PEGS:
        body += cone((2.5, COVER_BOTTOM - 1), (2.2, COVER_TOP - 0.6), at=peg)
    for axle in (PINION, WHEEL):
        at = (float(axle[0]), float(axle[1]))
        body += cylinder(5, 0, GEAR_BOTTOM - 0.1, at=at) + cylinder(3, 0, GEAR_TOP - 0.4, at=at)
    body -= outline_of([(14, 4), (36, 4)], radius=3.5).extrude(20).translate((0, 0, -1))
    body -= prism([(-20, 25), (-20, 44), (-13, 34), (-13, 25)], 1.2).translate(
        (0, 0, RULE_TOP - 1.2)
    )
    return body - outline_of([(-12, -52 + 8), (0, -50)], radius=3).extrude(9).translate((0, 0, -2))


def rule_solid() -> Manifold:
    """Frame: x along the rule from the measuring face, z up from the underside, y from the rack."""
    height = RULE_TOP - RULE_BOTTOM
    body = rounded_box((-16, 158), (-HALF_RULE, HALF_RULE), (0, height), radius=2)
    body += prism([(0, 9), (0, 56), (-3, 56), (-13, 42), (-16, 28), (-16, 9)], height)
    over_pinion = -BEAK_FACE + OPENING
    spaces = [over_pinion + PITCH * k for k in range(-6, 13)]
    for outline in rack(MODULE, spaces):
        body -= prism(outline, 20).translate((0, PITCH_LINE, -5))
    for k in range(28):
        reach = 7.0 if k % 2 == 0 else 4.5
        x = 5.0 * k + 4.0
        body -= box((x - 0.5, x + 0.5), (HALF_RULE - reach, HALF_RULE + 1), (height - 0.6, 9))
    body -= prism([(-13, 16), (-13, 32), (-4, 43), (-4, 16)], 1.2).translate((0, 0, height - 1.2))
    return body - cylinder(3.2, -1, 9, at=(151, 1))


def pinion_solid() -> Manifold:
    """Frame: z along the axle from the underside, a tooth on x."""
    body = gear(MODULE, PINION_TEETH).extrude(GEAR_TOP - GEAR_BOTTOM)
    ring = cylinder(9.2, 3.6, 9) - cylinder(6, 3, 9)
    return body - ring - cylinder(3.25, -1, 9)


def wheel_solid() -> Manifold:
    """Frame: z along the axle from the underside, a tooth on x; the bar on top drives it."""
    thick = GEAR_TOP - GEAR_BOTTOM
    body = gear(MODULE, WHEEL_TEETH).extrude(thick)
    for angle in (60, 120, 240, 300):
        body -= cylinder(3.6, -1, 9, at=(11.6, 0)).rotate((0, 0, angle))
    body += cylinder(6.2, 0, thick + 0.4) + _drive(0.0).translate((0, 0, thick))
    return body - cylinder(3.25, -1, thick - 0.2)


def _drive(gap: float) -> Manifold:
    """A round bar with two flats, which turns the wheel with the roller."""
    return cylinder(5.2 + gap, 0, 13) ^ box((-9, 9), (-3.4 - gap, 3.4 + gap), (0, 13))


def cover_solid() -> Manifold:
    """Frame: as the carriage's, from the cover's underside; open over rack, rule and pinion."""
    thick = COVER_TOP - COVER_BOTTOM
    hub = (float(WHEEL[0]), float(WHEEL[1]))
    section = outline_of([(-20, 16), (48, 16), (-18.2, -10), (46.2, -10)], radius=3.8)
    section += outline_of([(-17, -10), PEGS[2]], radius=5)
    section += outline_of([PEGS[2]], radius=6.5) + outline_of([hub], radius=11.5)
    section += outline_of([PEGS[2], hub], radius=4.5) + outline_of([(44, -8), hub], radius=5)
    body = section.extrude(thick)
    body -= outline_of([(-14, 1), (40, 1)], radius=6.5).extrude(9).translate((0, 0, -2))
    body -= cylinder(7.0, -1, 9, at=hub)
    for peg in PEGS:
        body -= cylinder(2.75, -1, 9, at=peg)
    for k in range(9):
        tick = box((-12.5 + 4.5 * k, -11.5 + 4.5 * k), (7, 12 if k % 4 else 14.5), (thick - 0.6, 9))
        body -= tick
    return body


def roller_solid() -> Manifold:
    """Frame: z along the axle from the underside; x points to the crank."""
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    body = polar_prism(15.0 + 0.7 * np.cos(20 * angle), 7.5)
    body ^= cone((14.2, 0), (16.2, 2)) + cylinder(16.2, 2, 5.5) + cone((16.2, 5.5), (14.2, 7.5))
    body -= cylinder(12.4, 6.0, 9) - cylinder(8.2, 5, 9)
    body += cylinder(4.2, 5, 9.5, at=(10.2, 0)) + cone((3.2, 9), (4.4, 21), at=(10.2, 0))
    return body - _drive(0.25).translate((0, 0, -4.2))
