from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from asdfviz.datatypes import Camera, Mesh
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.synth.description import Finish, Placed, Scene
from asdfviz.synth.gbuffer import Views, place_all
from asdfviz.synth.hands import hand_mesh
from asdfviz.synth.mesh_bank import MeshBank, clustered, corner_normals
from asdfviz.synth.primitives import box, lathe
from asdfviz.synth.raster import Projected, corner_weights, depth_map, rasterize
from asdfviz.synth.render import silhouettes

CAMERA = Camera(np.array([[150.0, 0, 79.5], [0, 150.0, 44.5], [0, 0, 1]]), 160, 90)
SHAPE = (1, 90, 160)


def scene(*poses: np.ndarray) -> Scene:
    grey = Finish(np.full(3, 0.4))
    placed = tuple(Placed(0, T, grey, "part", "box", truth=True) for T in poses)
    return Scene(CAMERA, np.eye(4), placed, (), (), np.ones(3))


def pose(x: float, y: float, z: float, turn: float = 0.0) -> np.ndarray:
    return transform_from(rotation_about(np.array([0.3, 1.0, 0.2]), turn), np.array([x, y, z]))


def projected(scenes: list[Scene], size: tuple[float, float, float]) -> Projected:
    bank = MeshBank.of([box(size)])
    return Views.of(scenes, scale=1.0, device="cpu").project(place_all(scenes, bank))


def test_box_face_on_covers_the_pixels_whose_centres_it_covers() -> None:
    size = (0.2, 0.1, 0.1)
    fragments = rasterize(projected([scene(pose(0, 0, 0.55))], size), SHAPE)
    # The front face lies at z = 0.5: half a width of 0.1 m is 30 px, half a height 15 px.
    u, v = np.meshgrid(np.arange(160), np.arange(90))
    expected = (np.abs(u - 79.5) < 30) & (np.abs(v - 44.5) < 15)
    mask = np.zeros(90 * 160, dtype=bool)
    mask[fragments.covered.numpy()] = True
    assert np.array_equal(mask.reshape(90, 160), expected)
    assert torch.allclose(fragments.depth, torch.tensor(0.5), atol=1e-6)


@pytest.mark.parametrize("x", [-6.0, 0.0, 5.5, 6.3])
def test_a_silhouette_is_whole_wherever_in_a_wide_image(x: float) -> None:
    wide = Camera(np.array([[150.0, 0, 2047.5], [0, 150.0, 44.5], [0, 0, 1]]), 4096, 90)
    one = replace(scene(pose(x, 0, 0.55)), camera=wide)
    triangles = place_all([one], MeshBank.of([box((0.2, 0.1, 0.1))]))
    seen = Views.of([one], scale=1.0, device="cpu").project(triangles)
    covered = rasterize(seen, (1, 90, 4096)).covered.numpy()
    v, u = np.divmod(covered, 4096)
    counts, boxes = silhouettes([one], triangles, seen)
    assert counts.tolist() == [len(covered)]
    assert boxes.tolist() == [[u.min(), v.min(), np.ptp(u) + 1, np.ptp(v) + 1]]


def test_depth_of_a_turned_box_is_the_ray_box_intersection() -> None:
    T = pose(0.02, -0.01, 0.5, turn=0.7)
    size = np.array([0.12, 0.16, 0.1])
    depth = depth_map(projected([scene(T)], tuple(size)), SHAPE)[0].numpy()
    u, v = np.meshgrid(np.arange(160.0), np.arange(90.0))
    rays = np.stack([(u - 79.5) / 150, (v - 44.5) / 150, np.ones_like(u)], axis=-1)
    origin, direction = -T[:3, :3].T @ T[:3, 3], rays @ T[:3, :3]
    low, high = (-size / 2 - origin) / direction, (size / 2 - origin) / direction
    near, far = np.minimum(low, high).max(axis=-1), np.maximum(low, high).min(axis=-1)
    hit = near < far
    assert hit.sum() > 1000
    assert (np.isfinite(depth) != hit).mean() < 1e-3
    both = hit & np.isfinite(depth)
    assert np.abs(depth - near)[both].max() < 1e-5


def test_corner_weights_give_back_the_position() -> None:
    triangles = projected([scene(pose(0.01, 0.0, 0.4, turn=0.5))], (0.1, 0.12, 0.08))
    fragments = rasterize(triangles, SHAPE)
    weights = corner_weights(triangles, fragments, SHAPE)
    corners = triangles.faces[fragments.face]
    z = (triangles.depth[corners] * weights).sum(1)
    assert torch.allclose(z, fragments.depth, atol=1e-5)
    assert float(weights.min()) > -1e-3


def test_a_batch_equals_its_single_images() -> None:
    scenes = [
        scene(pose(0, 0, 0.5, 0.2), pose(0.05, 0, 0.4, 1.0)),
        scene(pose(-0.1, 0.02, 0.7)),
        scene(pose(0, 0, 0.3, 2.0), pose(0, 0.05, 0.5), pose(-0.1, 0, 0.6)),
    ]
    size = (0.1, 0.06, 0.04)
    batch = depth_map(projected(scenes, size), (3, 90, 160))
    for i, one in enumerate(scenes):
        assert torch.equal(batch[i], depth_map(projected([one], size), SHAPE)[0])


def test_things_behind_or_at_the_camera_are_left_out() -> None:
    assert len(rasterize(projected([scene(pose(0, 0, -0.5))], (0.1, 0.1, 0.1)), SHAPE).covered) == 0


def test_normals_stay_sharp_at_edges_and_smooth_on_round_faces() -> None:
    flat = corner_normals(box((1.0, 1.0, 1.0)))
    assert np.allclose(np.abs(flat).max(axis=2), 1.0)
    tube = lathe(np.array([[1.0, -1.0], [1.0, 1.0]]), segments=24)
    normals = corner_normals(tube).reshape(-1, 3)
    corners = tube.vertices[tube.faces.reshape(-1)]
    assert (np.abs((normals * corners).sum(axis=1)) > 0.99).all()


def test_lasting_meshes_get_their_normals_once_and_as_any_other(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    part, lasting, caster = (
        box(size) for size in ((0.1, 0.1, 0.1), (0.2, 0.1, 0.1), (1.0, 1.0, 1.0))
    )
    meshes, casters = [part, lasting], {1: caster}
    plain = MeshBank.of(meshes, casters=casters)
    asked: list[object] = []

    def counted(mesh: Mesh, *, crease: float) -> np.ndarray:
        asked.append(mesh)
        return corner_normals(mesh, crease=crease)

    monkeypatch.setattr("asdfviz.synth.mesh_bank.corner_normals", counted)
    for _ in range(2):
        kept = MeshBank.of(meshes, casters=casters, lasting=(1,))
        assert torch.equal(kept.normals, plain.normals)
        assert kept.casters is not None
        assert plain.casters is not None
        assert torch.equal(kept.casters.normals, plain.casters.normals)
    assert asked == [part, lasting, caster, part]


def test_normals_of_a_fine_ball_point_outwards_everywhere() -> None:
    turn = np.linspace(0.1, np.pi - 0.1, 40)
    ball = lathe(np.stack([0.03 * np.sin(turn), -0.03 * np.cos(turn)], axis=1), segments=80)
    corners = ball.vertices[ball.faces]
    outward = corners / np.linalg.norm(corners, axis=2, keepdims=True)
    assert ((corner_normals(ball) * outward).sum(axis=2) > 0.99).all()


@pytest.mark.parametrize("cell", [0.004, 0.008])
def test_a_clustered_mesh_has_fewer_faces_on_the_same_surface(cell: float) -> None:
    hand = hand_mesh(0).mesh
    coarse = clustered(hand, cell)
    assert len(coarse.faces) < (0.9 if cell < 0.005 else 0.45) * len(hand.faces)
    known = {tuple(v) for v in hand.vertices}
    assert all(tuple(v) in known for v in coarse.vertices)
    a, b, c = np.sort(coarse.faces, axis=1).T
    assert ((a < b) & (b < c)).all()


def test_the_shadows_of_hands_are_the_hands_own_but_for_their_outline() -> None:
    fine = MeshBank.of([hand_mesh(0).mesh, box((0.1, 0.1, 0.1))])
    coarse = MeshBank.of(
        [hand_mesh(0).mesh, box((0.1, 0.1, 0.1))], casters={0: clustered(hand_mesh(0).mesh, 0.008)}
    ).casters
    assert coarse is not None
    hand = scene(pose(0, 0, 0.5, turn=0.4))
    shadow, thrown = (
        depth_map(Views.of([hand], scale=1.0, device="cpu").project(place_all([hand], bank)), SHAPE)
        for bank in (fine, coarse)
    )
    both = shadow.isfinite() & thrown.isfinite()
    assert int(both.sum()) > 0.95 * int(shadow.isfinite().sum()) > 500
    assert float((shadow - thrown)[both].abs().median()) < 0.001
