"""Our own screw clamp: two wooden-looking jaws on two threaded rods with knobs and pins; mm.

The lower jaw is the base and lies on its side: x runs to the nose, y to the other jaw, z up. Rods,
knobs, pins and pads come in twos, which share shape and detector class.
"""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, JoinType, Manifold

from asdfviz.datatypes import Joint
from asdfviz.geometry.shapes import Transform
from asdfviz.synth.own_design import ABOUT_Z, Design, Piece, Step, freedom, turned_alike
from asdfviz.synth.own_shapes import (
    ROUND,
    Length,
    box,
    cone,
    cylinder,
    hexagon,
    outline_of,
    placed,
    prism,
    rounded_box,
    thread,
)

BORES = (20.0, -24.0)
"""x of the front and the rear rod."""
SPARE = 2 * BORES[1] - BORES[0]
"""x of the upper jaw's third bore, as far from the second as that from the first."""
WIDTH, HALF_HEIGHT = 24.0, 15.0
"""Of a jaw along y, and along z either way."""
BEVEL = 1.2
GAP = 40.0
"""Between the jaws' inner faces in the nominal pose."""
CLOSING = (-20.0, 14.0)
"""Travel of rods and upper jaw towards the lower one."""
THREAD_RADIUS, PITCH, DEPTH, CLEARANCE = 7.0, 6.0, 1.5, 0.45
SEAT = 16.6
"""How deep a rod's tip sits in the upper jaw."""
TIP_RADIUS, THREAD_START, THREAD_END, ROD_LENGTH = 5.2, 17.0, 103.0, 122.0
FLANGE = (103.0, 108.0)
"""The rod's stop for the knob, from its tip."""
GROOVE = (5.0, 11.2)
"""The rod's groove, from its tip, that a pin runs in."""
GROOVE_RADIUS, PIN_RADIUS = 3.2, 2.7
PIN_OFFSET = GROOVE_RADIUS + PIN_RADIUS + 0.2
"""Along x from the rod's axis to the pin's."""
TRUNNION = (72.0, -2.0)
"""Middle of the upright bar on a jaw's nose that the pad turns about."""
NECK = (58.0, -5.2)
"""Where the bar's neck leaves the jaw."""
SWIVEL = (-8.0, 8.0)
"""Degrees."""


def design() -> Design:
    """The screw clamp in ten states and three mistakes."""
    return Design(
        "Screw clamp",
        (
            Piece(("lower_jaw",), lower_jaw_solid(), (150, 92, 48)),
            Piece(("pad", "pad-Copy"), pad_solid(), (40, 92, 168)),
            Piece(("rod", "rod-Copy"), rod_solid(), (188, 192, 198), ABOUT_Z),
            Piece(("knob", "knob-Copy"), knob_solid(), (176, 30, 38), turned_alike(3)),
            Piece(("upper_jaw",), upper_jaw_solid(), (214, 168, 112)),
            Piece(("pin", "pin-Copy"), pin_solid(), (44, 46, 52), ABOUT_Z),
        ),
        _steps(),
    )


def _steps() -> tuple[Step, ...]:
    x, down = (1, 0, 0), (0, 0, -1)
    rods = {name: _rod_joint(at) for name, at in zip(("front", "rear"), BORES, strict=True)}
    along = freedom("prismatic", (0, -1, 0), (0, 0, 0), slide_mm=CLOSING, link="rods")
    swivel = freedom("revolute", (0, 0, 1), (*TRUNNION, 0), turn_deg=SWIVEL)
    pad = placed((*TRUNNION, 0), x=x, z=(0, 0, 1))
    upper_pad = placed((TRUNNION[0], GAP - TRUNNION[1], 0), x=x, z=down)
    jaw = placed((0, GAP, 0), x=x, z=down)
    shifted = placed((BORES[0] - BORES[1], GAP, 0), x=x, z=down)
    turned = placed((BORES[0] + BORES[1], GAP, 0), x=(-1, 0, 0), z=(0, 0, 1))
    front_knob = {"knob": knob_pose(BORES[0])}, {"knob": rods["front"]}
    return (
        Step("lower_jaw"),
        Step("lower_pad", {"pad": pad}, {"pad": swivel}),
        Step("front_rod", {"rod": rod_pose(BORES[0])}, {"rod": rods["front"]}),
        Step("rear_rod", {"rod-Copy": rod_pose(BORES[1])}, {"rod-Copy": rods["rear"]}),
        Step("upper_jaw", {"upper_jaw": jaw}, {"upper_jaw": along}),
        Step("front_pin", {"pin": pin_pose(BORES[0])}, {"pin": along}),
        Step("rear_pin", {"pin-Copy": pin_pose(BORES[1])}, {"pin-Copy": along}),
        # Not earlier: their weight would tip the lower jaw over.
        Step("front_knob", *front_knob),
        Step("rear_knob", {"knob-Copy": knob_pose(BORES[1])}, {"knob-Copy": rods["rear"]}),
        Step("upper_pad", {"pad-Copy": upper_pad}, {"pad-Copy": along}),
        Step("jaw_shifted", {"upper_jaw": shifted}, {"upper_jaw": along}, after="rear_rod"),
        Step("jaw_reversed", {"upper_jaw": turned}, {"upper_jaw": along}, after="rear_rod"),
        Step("pins_missing", *front_knob, after="upper_jaw"),
    )


def _rod_joint(at: float) -> Joint:
    degrees = 360.0 / PITCH
    return freedom(
        "cylindrical",
        (0, -1, 0),
        (at, 0, 0),
        slide_mm=CLOSING,
        turn_deg=(CLOSING[0] * degrees, CLOSING[1] * degrees),
        link="rods",
    )


def rod_pose(at: float) -> Transform:
    """A rod in the bore at x = `at`, its tip in the upper jaw."""
    return placed((at, GAP + SEAT, 0), x=(0, 0, 1), z=(0, -1, 0))


def knob_pose(at: float) -> Transform:
    """A knob on the rod in the bore at x = `at`."""
    return placed((at, GAP + SEAT - FLANGE[1] - 0.2, 0), x=(0, 0, 1), z=(0, -1, 0))


def pin_pose(at: float) -> Transform:
    """A pin beside the rod in the bore at x = `at`, head on the upper jaw."""
    return placed((at + PIN_OFFSET, GAP + _groove_depth(), HALF_HEIGHT), x=(1, 0, 0), z=(0, 0, 1))


def _groove_depth() -> float:
    """From the upper jaw's inner face to the middle of the rods' groove."""
    return SEAT - (GROOVE[0] + GROOVE[1]) / 2


def lower_jaw_solid() -> Manifold:
    """Frame: x to the nose, y out of the inner face, z the height; origin on the inner face."""
    body = _jaw(-42.0)
    for at in BORES:
        into_rod = rod_pose(at)
        start, end = GAP + SEAT - 1, GAP + SEAT + WIDTH + 1
        nut = thread(THREAD_RADIUS + CLEARANCE, start, end, pitch=PITCH, depth=DEPTH)
        body -= nut.transform(into_rod[:3])
        for face in (0.0, -WIDTH):
            body -= _along_y(
                cone((6.4, -1.6), (9.6, 1.6)) if face else cone((9.6, -1.6), (6.4, 1.6)), at, face
            )
    return body - _window((-11, 7))


def upper_jaw_solid() -> Manifold:
    """Frame: as the lower jaw's; three blind bores in the inner face, pin holes across them."""
    body = _jaw(SPARE - 17.0)
    for at in (*BORES, SPARE):
        body -= _along_y(cylinder(TIP_RADIUS + 0.4, -1, SEAT + 0.6), at, 0.0)
        body -= cylinder(PIN_RADIUS + 0.3, -20, 20, at=(at + PIN_OFFSET, -_groove_depth()))
    return body - _window((-10, 8)) - _window((-54, -35))


def _jaw(tail: float) -> Manifold:
    """A jaw without bores, from x = `tail` to the bar on its nose."""
    block = CrossSection.batch_hull(
        [
            outline_of([(tail + 2, -2), (50, -2)], radius=2),
            outline_of([(tail + 7, -WIDTH + 7), (34, -WIDTH + 7)], radius=7),
            outline_of([(58, -5.5)], radius=3.5),
        ]
    )
    nose = _bevelled(outline_of([NECK, TRUNNION], radius=3.5))
    return _bevelled(block) + nose + _bevelled(outline_of([TRUNNION], radius=6))


def _bevelled(section: CrossSection) -> Manifold:
    """A convex section over the whole height of a jaw, its long edges broken."""
    waist = section.extrude(2 * (HALF_HEIGHT - BEVEL)).translate((0, 0, BEVEL - HALF_HEIGHT))
    inner = section.offset(-BEVEL, JoinType.Miter)
    core = inner.extrude(2 * HALF_HEIGHT).translate((0, 0, -HALF_HEIGHT))
    return Manifold.batch_hull([waist, core])


def _window(x: tuple[Length, Length]) -> Manifold:
    return rounded_box(x, (-17.5, -6.5), (-20, 20), radius=4)


def _along_y(solid: Manifold, at: float, face: float) -> Manifold:
    """Turn z into the depth under a face of a jaw, at x = `at`."""
    return solid.rotate((90, 0, 0)).translate((at, face, 0))


def rod_solid() -> Manifold:
    """Frame: z from the tip to the hexagonal end."""
    tip = cone((4.0, 0), (TIP_RADIUS, 1.4)) + cylinder(TIP_RADIUS, 1.4, GROOVE[0])
    tip += cylinder(GROOVE_RADIUS, GROOVE[0] - 1, GROOVE[1] + 1)
    tip += cylinder(TIP_RADIUS, GROOVE[1], THREAD_START + 1)
    shaft = thread(THREAD_RADIUS, THREAD_START, THREAD_END + 0.5, pitch=PITCH, depth=DEPTH)
    rounded = cone((5.4, THREAD_START), (8, THREAD_START + 2.6))
    rounded += cylinder(8, THREAD_START + 2.6, THREAD_END + 1)
    low, high = FLANGE
    flange = cone((10, low), (11.5, low + 1.5)) + cylinder(11.5, low + 1.5, high)
    return tip + (shaft ^ rounded) + flange + hexagon(9.0, high - 1, ROD_LENGTH)


def knob_solid() -> Manifold:
    """Frame: z from the mouth; three ridges, one of them on x."""
    profile = [(0, 0), (9, 0), (13, 5), (14, 12), (13.4, 26), (11.6, 37), (7.5, 43), (0, 43)]
    body = Manifold.revolve(CrossSection([np.array(profile, dtype=float)]), 36)
    for angle in (60, 180, 300):
        flute = cylinder(7, 11, 34) + Manifold.sphere(7, ROUND).translate((0, 0, 11))
        flute += Manifold.sphere(7, ROUND).translate((0, 0, 34))
        body -= flute.translate((17.8, 0, 0)).rotate((0, 0, angle))
    return body - hexagon(9.5, -1, ROD_LENGTH - FLANGE[1] + 0.6)


def pin_solid() -> Manifold:
    """Frame: z along the pin, origin under its head."""
    shaft = cone((1.8, -29.5), (PIN_RADIUS, -28)) + cylinder(PIN_RADIUS, -28, 1)
    return shaft + cylinder(6, 0, 3) + cone((6, 3), (4.2, 5))


def pad_solid() -> Manifold:
    """Frame: origin in the bar it turns about, y to the gripping face, x to the nose's end."""
    height = 26.0
    plate = CrossSection.batch_hull(
        [
            outline_of([(-10, 9.5), (21, 9.5)], radius=2),
            outline_of([(-11.5, 12), (22.5, 12)], radius=1),
        ]
    )
    section = plate + CrossSection.circle(9.7, 32)
    body = section.extrude(height) - cylinder(6.3, -1, height + 1)
    angle = np.arctan2(NECK[1] - TRUNNION[1], NECK[0] - TRUNNION[0])
    mouth = [(0.0, 0.0)] + [
        (30 * float(np.cos(angle + turn)), 30 * float(np.sin(angle + turn)))
        for turn in np.deg2rad([-52, -20, 20, 52])
    ]
    body -= prism(mouth, height + 2).translate((0, 0, -1)) - box((-40, 40), (7.5, 40), (-2, 40))
    for k in range(6):
        x = -8.5 + 5.5 * k
        groove = prism([(x - 1.6, 13.3), (x + 1.6, 13.3), (x, 11.6)], height + 2)
        body -= groove.translate((0, 0, -1))
    return body.translate((0, 0, -height / 2))
