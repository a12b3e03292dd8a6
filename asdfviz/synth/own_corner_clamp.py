"""The shapes of our own sample assembly, a corner clamp, in code; millimetres throughout.

Two fences of unequal length and height meet over the base's inner corner. A wedge slides on the
diagonal towards it, pushed by a bolt through a threaded block. Base and jaw carry bosses, slots
and a lever that no turn maps onto themselves, so that their orientation shows from any side.
"""

from __future__ import annotations

import numpy as np
from manifold3d import CrossSection, Manifold

from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.synth.own_design import ABOUT_Z, Design, Piece, Step, freedom
from asdfviz.synth.own_shapes import Length, axes, box, cylinder, polar_prism, prism

PLATE = 8.0
"""Thickness of the base plate."""
AXIS_HEIGHT = 22.0
"""Height of the bolt's axis over the underside of the base."""
JAW_LIFT = 0.2
"""Gap between the plate and the jaw that slides on it."""
JAW_TIP = 16.0
"""Distance of the jaw's tip from the inner corner, on the diagonal, in the nominal pose."""
JAW_LENGTH = 34.0
BOLT_TIP = JAW_TIP + JAW_LENGTH - 5.0
"""Distance of the bolt's tip from the inner corner: 5 mm inside the jaw's socket."""
SLIDE = (-9.0, 9.0)
"""Travel of jaw and bolt on the diagonal about the nominal pose."""
REVERSED_SLIDE = (-2.0, 3.0)
"""Travel of a jaw put in the wrong way round, between the fences and the block."""
BLOCK = (66.0, 84.0)
"""The threaded block's stretch of the diagonal."""
THREAD_RADIUS, THREAD_CLEARANCE = 6.0, 0.3
DIAGONAL = np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0)


def design() -> Design:
    """The corner clamp: base, jaw, bolt, and the jaw put in the wrong way round."""
    axle = (0.0, 0.0, AXIS_HEIGHT)
    # Jaw and bolt share axis and travel: they move together, tip in socket.
    jaw = freedom("prismatic", DIAGONAL, axle, slide_mm=SLIDE)
    bolt = freedom("cylindrical", DIAGONAL, axle, slide_mm=SLIDE, turn_deg=(-180.0, 180.0))
    stuck = freedom("prismatic", DIAGONAL, axle, slide_mm=REVERSED_SLIDE)
    return Design(
        "Corner clamp",
        (
            Piece(("base",), base_solid(), (0, 90, 170)),
            Piece(("jaw",), jaw_solid(), (225, 120, 20)),
            Piece(("bolt",), bolt_solid(), (205, 205, 200), ABOUT_Z),
        ),
        (
            Step("base"),
            Step("jaw", {"jaw": jaw_pose()}, {"jaw": jaw}),
            Step("bolt", {"bolt": bolt_pose()}, {"bolt": bolt}),
            Step("jaw_reversed", {"jaw": reversed_jaw_pose()}, {"jaw": stuck}, after="base"),
        ),
    )


def jaw_pose() -> Transform:
    """The jaw in the base's frame (mm), tip to the inner corner."""
    t = DIAGONAL * JAW_TIP + [0.0, 0.0, PLATE + JAW_LIFT]
    return transform_from(axes(-DIAGONAL, np.array([0.0, 0.0, 1.0])), t)


def reversed_jaw_pose() -> Transform:
    """The jaw in the base's frame (mm), put in the wrong way round: its back to the corner."""
    t = DIAGONAL * (JAW_LENGTH + 28.5) + [0.0, 0.0, PLATE + JAW_LIFT]
    return transform_from(axes(DIAGONAL, np.array([0.0, 0.0, 1.0])), t)


def bolt_pose() -> Transform:
    """The bolt in the base's frame (mm), screwed in until its tip sits in the jaw."""
    side = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    R = axes(side, DIAGONAL)
    return transform_from(R, DIAGONAL * BOLT_TIP + [0.0, 0.0, AXIS_HEIGHT])


def base_solid() -> Manifold:
    """Frame: x along the long fence, y along the short one, z up, origin in the inner corner."""
    body = box((-14, 80), (-14, 20), (0, PLATE)) + box((-14, 20), (-14, 52), (0, PLATE))
    body += _on_diagonal(box((0, 86), (-15, 15), (0, PLATE)))
    body += cylinder(11, 0, PLATE, at=(88, -3)) + cylinder(7, 0, 24, at=(88, -3))
    body += box((-14, 10), (50, 68), (0, PLATE))
    body += box((-14, 78), (-14, 0), (0, 30)) + box((-14, 0), (-14, 50), (0, 21))
    body += prism(
        [(14, -7), (26, -13), (26, -9.5), (44, -9.5), (44, -4.5), (26, -4.5), (26, -1)], 33
    )
    body += box((-12, -3), (26, 36), (0, 27))
    block = box(BLOCK, (-14, 14), (0, 38)) - box((BLOCK[0] + 11, BLOCK[1] + 1), (-15, 15), (33, 39))
    body += _on_diagonal(block)
    body -= _on_diagonal(box((13, 60), (-4, 4), (4, PLATE + 1)))
    body -= cylinder(5, PLATE, 60) + cylinder(3.5, -1, 40, at=(88, -3))
    body -= box((-8.5, 4.5), (57, 62), (-1, PLATE + 1))
    body -= box((28, 70), (-8, 12), (-1, 2.5)) + cylinder(9, -1, 3, at=(3, 34))
    nut = _thread(THREAD_RADIUS + THREAD_CLEARANCE, start=8, length=43)
    return body - nut.transform(bolt_pose()[:3])


def jaw_solid() -> Manifold:
    """Frame: x points to the corner with the tip near x = 0, z up, origin on the underside."""
    back = -JAW_LENGTH
    body = prism([(-2, -2), (-2, 2), (-26, 26), (back, 26), (back, -26), (-26, -26)], 20)
    body += box((-30, -10), (-3.7, 3.7), (-3.6, 1))
    body += cylinder(4.5, 19, 40, at=(-24, 15)) + Manifold.sphere(7.5, 20).translate((-24, 15, 40))
    body += box((-32, -18), (-22, -10), (19, 24)) - box((-33, -17), (-17.5, -14.5), (21.5, 25))
    body -= box((-3.5, 3.5), (-3.5, 3.5), (-1, 21)).rotate((0, 0, 45)).translate((-14, -14, 0))
    socket = cylinder(4.8, 0, 7, at=(0, 0)).rotate((0, 90, 0))
    return body - socket.translate((back - 1, 0, AXIS_HEIGHT - PLATE - JAW_LIFT))


def bolt_solid() -> Manifold:
    """Frame: z along the axis, from the tip at z = 0 to the hexagonal head."""
    tip = Manifold.cylinder(1.5, 2.8, 4, 20) + cylinder(4, 1.5, 9)
    shaft = _thread(THREAD_RADIUS, start=8, length=43)
    angle = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    knurl = polar_prism(15.0 + 0.5 * np.sign(np.sin(24 * angle + 0.1)), 11)
    chamfer = Manifold.cylinder(2.5, 12, 16, 32) + cylinder(16, 2.5, 11)
    head = Manifold.cylinder(9, 8.4, 8.4, 6).translate((0, 0, 66))
    return tip + shaft + cylinder(9, 50, 57) + (knurl ^ chamfer).translate((0, 0, 56)) + head


def _on_diagonal(solid: Manifold) -> Manifold:
    return solid.rotate((0, 0, 45))


def _thread(radius: Length, *, start: Length, length: Length) -> Manifold:
    """A left-handed V-thread of pitch 4: a cross-section whose radius falls and rises once a turn, twisted."""
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    reach = radius - 1.1 * np.abs(angle / np.pi - 1)
    section = CrossSection([np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=1)])
    turns = length / 4.0
    return section.extrude(length, int(10 * turns), -360 * turns).translate((0, 0, start))
