"""About which point a part is turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from asdfviz.data.assembly import load_assembly
from asdfviz.datatypes import Mesh
from asdfviz.geometry.shapes import Points, Vector
from asdfviz.track.bodies import Body, centre_of_mass

AWAY = np.array([0.2, 0.0, -0.1])
"""Of the bracket from its CAD origin, metres."""


def bracket() -> Mesh:
    """Two legs of 60 and 30 mm, 10 mm square, that meet in a corner."""
    legs = [
        trimesh.creation.box(extents, trimesh.transformations.translation_matrix(middle))
        for extents, middle in (
            ((0.06, 0.01, 0.01), (0.03, 0.005, 0.005)),
            ((0.01, 0.02, 0.01), (0.005, 0.02, 0.005)),
        )
    ]
    vertices = np.concatenate([np.asarray(leg.vertices) for leg in legs])
    faces = np.concatenate([np.asarray(leg.faces) + 8 * i for i, leg in enumerate(legs)])
    return Mesh(vertices + AWAY, faces.astype(np.int32))


def covered(points: Points, about: Vector) -> float:
    """Share of what a flat part covers, seen from above, that it covers half turned too."""
    turned = (points - about) @ np.diag([-1.0, -1.0, 1.0]) + about
    cells = [{tuple(c) for c in np.floor(p[:, :2] / 0.002).astype(int)} for p in (points, turned)]
    return len(cells[0] & cells[1]) / len(cells[0] | cells[1])


def test_turned_about_its_centre_of_mass_a_part_covers_more_of_what_it_covered() -> None:
    mesh = bracket()
    solid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points = trimesh.sample.sample_surface(solid, 20_000, seed=1)[0]
    surface = np.asarray(points, np.float64)
    about_mass = covered(surface, centre_of_mass(mesh))
    assert about_mass > 1.5 * covered(surface, mesh.middle)


def test_the_centre_of_mass_is_that_of_the_solid() -> None:
    # Volumes 6 and 2 cm3: the legs' middles, weighted by those.
    expected = (6 * np.array([0.03, 0.005, 0.005]) + 2 * np.array([0.005, 0.02, 0.005])) / 8
    np.testing.assert_allclose(centre_of_mass(bracket()), expected + AWAY, atol=1e-9)


def test_where_a_mesh_encloses_nothing_it_is_that_of_its_surface() -> None:
    mesh = bracket()
    lid = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    upright = np.abs(lid.face_normals[:, 2]) > 0.5  # upper and lower sides alone
    flat = Mesh(mesh.vertices, np.ascontiguousarray(mesh.faces[upright]))
    expected = (6 * np.array([0.03, 0.005]) + 2 * np.array([0.005, 0.02])) / 8
    found = centre_of_mass(flat)
    np.testing.assert_allclose(found[:2], expected + AWAY[:2], atol=1e-9)


def test_a_body_has_its_parts_symmetries_about_its_middle(box_body: Body) -> None:
    bolt = load_assembly("corner_clamp").parts["bolt"]
    model = replace(box_body.model, centre=np.array([0.01, 0.02, 0.03]))
    (axis,) = Body.of(bolt, model).symmetries.continuous
    np.testing.assert_array_equal(axis.offset, bolt.symmetries.continuous[0].offset - model.centre)
