"""Our own hobby vise: a jaw driven by a screw with a cross handle, on a ball in a foot; mm.

The body is the base: x runs along the screw, away from the foot; z up from the underside.
"""

from __future__ import annotations

import numpy as np
from manifold3d import Manifold

from asdfviz.geometry.shapes import Transform
from asdfviz.synth.own_design import ABOUT_Z, Design, Piece, Step, freedom
from asdfviz.synth.own_shapes import (
    Length,
    Outline,
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

HALF_JAW = 28.0
"""Half the width of both jaws."""
JAW_FACE = -26.0
"""x of the fixed jaw's gripping face."""
BLOCK = (42.0, 56.0)
"""The threaded block's stretch of x."""
SCREW_HEIGHT, STUD_HEIGHT = 31.0, 32.0
"""Of the axes over the underside."""
RAIL_TOP = 16.0
THREAD_RADIUS, PITCH, DEPTH, CLEARANCE = 7.0, 5.0, 1.3, 0.45
SLIDER_FRONT = 0.0
"""x of the slider's front in the nominal pose."""
SLIDER_LENGTH, SOCKET = 26.0, 7.0
"""Of the socket: the depth of the screw's seat in the slider's back."""
SCREW_TIP = SLIDER_FRONT + SLIDER_LENGTH - SOCKET + 0.3
"""x of the screw's end in the nominal pose."""
CROSS_HOLE = 72.0
"""Of the handle, from the screw's tip."""
PEGS, PEG_DROP = (-8.0, 8.0), 4.0
"""y of the pad's pegs, and how far they lie under the screw's axis."""
TRAVEL = (-15.0, 13.0)
"""Of slider and screw along x about the nominal pose."""
PEG_PITCH = 16.0
"""How far off a pad sits that is plugged into the next hole."""
REAR = -56.0
"""x of the end that holds the ball stud."""
BALL_OUT, BALL_RADIUS = 35.0, 9.0
"""Height of the ball's centre in the stud's frame, of which HELD are in the body."""
HELD = 12.0
FOOT_DEPTH = 17.0
"""From the ball's centre to the underside of the foot."""
TILT = (-14.0, 14.0)
"""Degrees that the foot may turn about the ball."""


def design() -> Design:
    """The vise in eight states and three mistakes."""
    return Design(
        "Vise",
        (
            Piece(("body",), body_solid(), (24, 98, 88)),
            Piece(("slider",), slider_solid(), (240, 184, 40)),
            Piece(("screw",), screw_solid(), (62, 66, 74), ABOUT_Z),
            Piece(("handle",), handle_solid(), (200, 202, 206), ABOUT_Z),
            Piece(("cap",), cap_solid(), (204, 44, 40), ABOUT_Z),
            Piece(("pad",), pad_solid(), (232, 108, 32)),
            Piece(("stud",), stud_solid(), (236, 234, 226), ABOUT_Z),
            Piece(("foot",), foot_solid(), (52, 84, 150)),
            Piece(("collar",), collar_solid(), (150, 60, 140)),
        ),
        _steps(),
    )


def _steps() -> tuple[Step, ...]:
    center = (REAR + HELD - BALL_OUT, 0, STUD_HEIGHT)
    turn = 360.0 / PITCH
    along = freedom("prismatic", (1, 0, 0), (0, 0, 0), slide_mm=TRAVEL, link="screw")
    screwed = freedom(
        "cylindrical",
        (1, 0, 0),
        (0, 0, SCREW_HEIGHT),
        slide_mm=TRAVEL,
        turn_deg=(TRAVEL[0] * turn, TRAVEL[1] * turn),
        link="screw",
    )
    on_ball = freedom("ball", (1, 0, 0), center, turn_deg=TILT)
    x, y, z = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    slider = placed((SLIDER_FRONT, 0, 0), x=x, z=z)
    reversed_slider = placed((SLIDER_FRONT + SLIDER_LENGTH, 0, 0), x=(-1, 0, 0), z=z)
    screw = {"screw": screw_pose()}
    # The handle lies across, so that it shows from above.
    bar = {
        "handle": placed((SCREW_TIP + CROSS_HOLE, -25, SCREW_HEIGHT), x=x, z=y),
        "cap": placed((SCREW_TIP + CROSS_HOLE, 12.5, SCREW_HEIGHT), x=x, z=y),
    }
    pad = placed((SLIDER_FRONT, 0, SCREW_HEIGHT), x=x, z=z)
    pad_beside = placed((SLIDER_FRONT, PEG_PITCH, SCREW_HEIGHT), x=x, z=z)
    stud = {"stud": placed((REAR + HELD, 0, STUD_HEIGHT), x=y, z=(-1, 0, 0))}
    foot = {"foot": placed((center[0] - FOOT_DEPTH, 0, STUD_HEIGHT), x=z, z=x)}
    collar = {"collar": placed(center, x=z, z=x)}
    return (
        Step("body"),
        Step("slider", {"slider": slider}, {"slider": along}),
        Step("screw", screw, {"screw": screwed}),
        Step("handle", bar, {"handle": screwed, "cap": screwed}),
        Step("pad", {"pad": pad}, {"pad": along}),
        Step("stud", stud),
        Step("foot", foot, {"foot": on_ball}),
        Step("collar", collar, {"collar": on_ball}),
        Step("slider_reversed", {"slider": reversed_slider}, {"slider": along}, after="body"),
        Step("slider_missing", screw, {"screw": screwed}, after="body"),
        Step("pad_beside", {"pad": pad_beside}, {"pad": along}, after="handle"),
    )


def screw_pose() -> Transform:
    """The screw in the body, its tip in the slider's socket."""
    return placed((SCREW_TIP, 0, SCREW_HEIGHT), x=(0, 0, 1), z=(1, 0, 0))


def body_solid() -> Manifold:
    """Frame: x along the screw to its head, z up from the underside, origin in the middle."""
    body = rounded_box((-46, 58), (-21, 21), (0, 9), radius=4)
    body += box((JAW_FACE - 2, BLOCK[0] + 1), (-10, 10), (8, RAIL_TOP))
    side = [(-46, 0), (JAW_FACE, 0), (JAW_FACE, 46), (-39, 46), (-46, 40)]
    body += _across(side, HALF_JAW)
    block = [(-15, 0), (15, 0), (15, 30), (9, 44), (-9, 44), (-15, 30)]
    body += prism(block, BLOCK[1] - BLOCK[0]).transform(_on_x(BLOCK[0]))
    body += cylinder(12.5, 0, 15).transform(_on_x(REAR, height=STUD_HEIGHT))
    for height in (22, 28, 34, 40):
        groove = [(JAW_FACE - 1.2, height), (JAW_FACE + 1, height - 2), (JAW_FACE + 1, height + 2)]
        body -= _across(groove, 40)
    body -= hexagon(12, -1, HELD + 0.3).transform(_on_x(REAR, height=STUD_HEIGHT))
    start, end = BLOCK[0] - SCREW_TIP - 1, BLOCK[1] - SCREW_TIP + 1
    nut = thread(THREAD_RADIUS + CLEARANCE, start, end, pitch=PITCH, depth=DEPTH)
    body -= nut.transform(screw_pose()[:3])
    for x in (-14, 26):
        body -= rounded_box((x - 8, x + 8), (13.5, 18), (-1, 10), radius=2)
    body -= rounded_box((-22, 34), (-18, -13.5), (-1, 10), radius=2)
    return body - rounded_box((-42, -32), (14, 24), (40, 50), radius=3)


def slider_solid() -> Manifold:
    """Frame: the body's, from the slider's front; x to its back."""
    body = rounded_box((0, 14), (-HALF_JAW, HALF_JAW), (9.3, 46), radius=2)
    back = [(8, 9.3), (SLIDER_LENGTH, 9.3), (SLIDER_LENGTH, 38), (20, 42), (8, 42)]
    body += _across(back, 14)
    for side in (-1, 1):
        rib = [(10, 9.3), (21, 9.3), (21, 14), (13, 32), (10, 32)]
        body += _across(rib, 2).translate((0, side * 22.0, 0))
    body -= box((-1, 40), (-10.4, 10.4), (0, RAIL_TOP + 0.3))
    seat = cylinder(5.2, 0, SOCKET + 1).transform(
        _on_x(SLIDER_LENGTH - SOCKET, height=SCREW_HEIGHT)
    )
    for y in (*PEGS, PEGS[1] + PEG_PITCH):
        body -= (
            cylinder(2.25, -1, 5.6).transform(_on_x(0)).translate((0, y, SCREW_HEIGHT - PEG_DROP))
        )
    return body - seat


def screw_solid() -> Manifold:
    """Frame: z along the axis, from the tip to the head; the cross hole runs along y."""
    tip = cone((3.6, 0), (4.8, 1.4)) + cylinder(4.8, 1.4, 10)
    shaft = thread(THREAD_RADIUS, 9, 58, pitch=PITCH, depth=DEPTH) + cylinder(5.7, 57, 64)
    head = cone((8.5, 61), (11, 64)) + cylinder(11, 64, 81) + cone((11, 81), (8.5, 83.5))
    hole = cylinder(3.6, -20, 20).rotate((90, 0, 0)).translate((0, 0, CROSS_HOLE))
    return tip + shaft + head - hole


def handle_solid() -> Manifold:
    """Frame: z along the bar from its knob."""
    knob = cone((5.6, 0), (7.5, 2.2)) + cylinder(7.5, 2.2, 8.5) + cone((7.5, 8.5), (4.6, 12))
    return knob + cylinder(3.3, 11, 46) + cone((3.3, 46), (2.6, 47))


def cap_solid() -> Manifold:
    """Frame: z along the bar, from the open end."""
    knob = cone((4.9, 0), (7.5, 3.0)) + cylinder(7.5, 3.0, 9.8) + cone((7.5, 9.8), (5.6, 12))
    return knob - cylinder(3.5, -1, 9.8)


def pad_solid() -> Manifold:
    """Frame: x from the gripping face through the back, which is x = 0; z up from the pegs' level."""
    body = rounded_box((-6, 0), (-22, 22), (-15, 18.2), radius=1)
    body += box((-2, 7), (-18, 18), (15.3, 18.2))
    body -= _across([(-7, 5), (-7, -5), (-3, 0)], 40)
    body -= prism([(-7, -5), (-7, 5), (-3, 0)], 60).translate((0, 0, -30))
    for y in PEGS:
        peg = cylinder(2, 0, 4) + cone((2, 4), (1.5, 5))
        body += peg.transform(_on_x(-0.5)).translate((0, y, -PEG_DROP))
    return body


def stud_solid() -> Manifold:
    """Frame: z from the hexagonal end to the ball."""
    body = hexagon(11.6, 0, HELD) + cylinder(11, HELD, HELD + 3) + cylinder(4.5, HELD, 30)
    body += cone((6.5, HELD + 3), (4.5, HELD + 5))
    return body + Manifold.sphere(BALL_RADIUS, 28).translate((0, 0, BALL_OUT))


def foot_solid() -> Manifold:
    """Frame: z from the underside to the ball; x away from the flat edge."""
    plate = Manifold.cylinder(5, 27, 27, 48) ^ box((-16, 30), (-30, 30), (0, 5))
    body = plate + cylinder(13.5, 4, FOOT_DEPTH + 5) + cone((16.5, 5), (13.5, 8))
    body -= Manifold.sphere(BALL_RADIUS + 0.3, 28).translate((0, 0, FOOT_DEPTH))
    for angle in (45, 135):
        body -= box((-30, 30), (-1, 1), (FOOT_DEPTH - 4, 30)).rotate((0, 0, angle))
    for angle in (0, 118, -118):
        hole = cylinder(2.2, -1, 9) + cone((2.2, 2.6), (4.6, 5.01))
        body -= hole.translate((21, 0, 0)).rotate((0, 0, angle))
    return body


def collar_solid() -> Manifold:
    """Frame: origin in the ball's centre, z away from the foot, the slot towards -x."""
    body = cylinder(17.5, -5, 8.3)
    for side in (-1, 1):
        body += (
            outline_of([(0, 15 * side), (3, 22.5 * side)], radius=3)
            .extrude(13.3)
            .translate((0, 0, -5))
        )
    body -= cylinder(13.8, -6, 5.3) + cylinder(9.2, 0, 9)
    return body - box((-30, 0), (-5.1, 5.1), (-9, 9))


def _across(outline: Outline, half: Length) -> Manifold:
    """An outline in x and z, extruded across the vise."""
    return prism(outline, 2 * half).rotate((90, 0, 0)).translate((0, half, 0))


def _on_x(x: Length, *, height: Length = 0.0) -> np.ndarray:
    """From a frame whose z runs along the screw, x across and y up, in mm (3 x 4)."""
    return placed((x, 0, height), x=(0, 1, 0), z=(1, 0, 0))[:3]
