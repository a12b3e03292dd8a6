"""Labels and masks of a picture that was just rendered, from what the renderer knows exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from asdfviz.data.scene_objects import SceneObject
from asdfviz.geometry.shapes import Mask
from asdfviz.pose.labels import SMALLEST_VISIBLE, LabelledObject, Labeller, Subject
from asdfviz.pose.labels import Group as LabelGroup
from asdfviz.pose.yolo_rows import yolo_rows
from asdfviz.synth.description import Scene
from asdfviz.synth.gbuffer import Views, place_all
from asdfviz.synth.mesh_bank import MeshBank
from asdfviz.synth.raster import Projected, rasterize
from asdfviz.synth.render import Picture
from asdfviz.synth.scene import TrueScene

_AT_ONCE = 8
"""Silhouettes that are drawn together."""


def label_text(
    true_scene: TrueScene, picture: Picture, order: Sequence[int], subject: Subject
) -> str:
    """The YOLO-pose label file of a picture; arguments as for `picture_labels`."""
    camera = true_scene.scene.camera
    labels = picture_labels(true_scene, picture, order, subject)
    return yolo_rows(labels, width=camera.width, height=camera.height)


def picture_labels(
    true_scene: TrueScene, picture: Picture, order: Sequence[int], subject: Subject
) -> tuple[LabelledObject, ...]:
    """The detector's labels of a picture.

    Args:
        true_scene: what is there.
        picture: its exact depth tells hidden keypoints from visible ones.
        order: places in Scene.placed of the truth's objects, as scene_gt.json lists them.
        subject: the assembly.
    """
    scene = true_scene.scene
    pixels = np.bincount(picture.ids.reshape(-1) + 1, minlength=len(scene.placed) + 1)[1:]
    whole = np.maximum(picture.silhouette_px, pixels)
    objects = tuple(
        SceneObject(
            scene.placed[i].name,
            scene.T_camera_world @ scene.placed[i].T_world_mesh,
            float(pixels[i] / max(int(whole[i]), 1)),
        )
        for i in order
    )
    place = {index: k for k, index in enumerate(order)}
    groups = tuple(
        LabelGroup(group.state.name, tuple(place[i] for i in group.members))
        for group in true_scene.groups
    )
    camera = scene.camera
    size = (camera.width, camera.height)
    labeller = Labeller(subject, camera.K, size, picture.depth, SMALLEST_VISIBLE)
    return labeller.labels(objects, groups)


def silhouette_masks(scene: Scene, bank: MeshBank, places: Sequence[int]) -> list[Mask]:
    """Which pixels of the image each placed thing would cover if it stood alone.

    Args:
        scene: the scene.
        bank: the meshes that it names.
        places: in Scene.placed.
    """
    camera = scene.camera
    device = str(bank.vertices.device)
    view = Views.of([scene], scale=1.0, device=device)
    masks: list[Mask] = []
    for first in range(0, len(places), _AT_ONCE):
        chosen = [scene.placed[i] for i in places[first : first + _AT_ONCE]]
        alone = Scene(camera, scene.T_camera_world, tuple(chosen), (), (), scene.sky)
        with torch.inference_mode():
            triangles = place_all([alone], bank)
            all_in_one = view.project(triangles)
            # Every thing is an image of its own.
            apart = Projected(
                all_in_one.points_px, all_in_one.depth, triangles.faces, triangles.instance
            )
            shape = (len(chosen), camera.height, camera.width)
            covered = rasterize(apart, shape).covered.cpu().numpy()
        flat = np.zeros(int(np.prod(shape)), bool)
        flat[covered] = True
        masks += list(flat.reshape(shape))
    return masks
