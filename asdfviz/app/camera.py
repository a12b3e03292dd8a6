"""Places the viewer's camera: pinned over the picture in AR, free in 3D; and reads it back."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from asdfviz.app import actions as act
from asdfviz.app.ar import ORBIT, look_direction, pixel_at
from asdfviz.app.drawings import T_from_wxyz
from asdfviz.app.view import Facts, View, centre_of, window_of
from asdfviz.geometry.shapes import Vector

DRIFT = 1e-4
"""Metres off the pinned centre that are put right; turning by hand moves it by less."""
STALE = 1e-3
"""Radians between a camera's rotation and its own point looked at beyond which the two are of other moments."""
_FREE_FOV = 0.75
_FAR = 60.0


def place_ar(client: Any, view: View, facts: Facts) -> None:
    """Pin the centre at the camera's own and turn it to the middle of the view."""
    camera = client.camera
    z = look_direction(facts.K, centre_of(view, facts))
    with client.atomic():
        # The smaller bound first: viser refuses a minimum above the maximum.
        camera.min_orbit_distance = ORBIT
        camera.max_orbit_distance = ORBIT
        camera.up_direction = (0.0, -1.0, 0.0)
        # viser sends only what differs from what it believes, which a page that comes back has lost.
        camera.position = (0.0, 0.0, -1.0)
        camera.position = (0.0, 0.0, 0.0)
        camera.look_at = tuple(float(c) for c in z)
        camera.look_at = tuple(float(c) for c in z * ORBIT)
        camera.fov = window_of(view, facts).fov(view.zoom)
        camera.near = 0.01
        camera.far = _FAR


def has_drifted(camera: Any, view: View) -> bool:
    """Whether the centre that AR pins is anywhere else, as after a lost connection."""
    return view.mode == "ar" and float(np.linalg.norm(camera.position)) > DRIFT


def place_free(client: Any, target: Vector) -> None:
    """Stand beside the real camera and look at the scene, free to orbit."""
    camera = client.camera
    distance = max(float(np.linalg.norm(target)), 0.2)
    eye = target + distance * np.array([0.36, -0.42, -0.83])
    with client.atomic():
        camera.max_orbit_distance = 50.0
        camera.min_orbit_distance = 0.02
        camera.up_direction = (0.0, -1.0, 0.0)
        camera.position = tuple(float(c) for c in eye)
        camera.look_at = tuple(float(c) for c in target)
        camera.fov = _FREE_FOV
        camera.near = 0.01
        camera.far = _FAR


def looked_at(camera: Any, view: View, facts: Facts) -> act.Look | None:
    """The pixel that the viewer turned to by hand; None while an order of ours is still on its way."""
    if view.mode != "ar" or abs(camera.fov - window_of(view, facts).fov(view.zoom)) > 1e-4:
        return None
    R = T_from_wxyz(camera.wxyz, np.zeros(3))[:3, :3]
    # viser reports a new field of view at once, before the next picture turns to the new point.
    ahead = np.asarray(camera.look_at) - np.asarray(camera.position)
    if np.linalg.norm(np.cross(R[:, 2], ahead)) > STALE * np.linalg.norm(ahead):
        return None
    u, v = pixel_at(facts.K, R, fov=camera.fov, aspect=view.aspect, ndc=(0.0, 0.0))
    return act.Look(u, v)


def listen(
    client: Any,
    view: Callable[[], View],
    facts: Callable[[], Facts],
    emit: Callable[[act.Action], None],
) -> None:
    """Emit what the viewer's camera and window do, by the view and facts of that moment."""

    async def moved(cam: Any) -> None:
        aspect = float(cam.aspect)
        if abs(aspect - view().aspect) > 1e-6:
            emit(act.Resized(aspect))
            return
        if has_drifted(cam, view()):
            emit(act.Drifted())
            return
        look = looked_at(cam, view(), facts())
        if look is not None:
            emit(look)

    client.camera.on_update(moved)
