"""Sparse viewpoint model: what a part looks like from every side, as a few hundred points a view.

Made once a part (`viewpoint_cache` keeps it), used by both modalities. A view holds points on the
contour of the silhouette, with normals and with the widths of foreground and background across
them, and points on the visible surface with their normals (Stoiber et al., SRT3D, 2022, sec. 3.2;
ICG, 2022, sec. 3.3). All lengths are metres; points are relative to `centre`, in part axes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float32, Float64, Int32, Int64

from asdfviz.datatypes import Mesh
from asdfviz.errors import Stopped
from asdfviz.geometry.shapes import Points, Transform, Vector
from asdfviz.geometry.transforms import transform_from
from asdfviz.track import raster, viewpoint_kernels
from asdfviz.track.view_choice import VIEWS, nearest_views

ViewNumbers: TypeAlias = Float32[np.ndarray, "v"]
Indices: TypeAlias = Int64[np.ndarray, "n"]
FaceIndices: TypeAlias = Int32[np.ndarray, "n"]

CONTOUR_COLUMNS = 8
"""x y z, normal x y z, foreground width, background width."""
GOLDEN = (5**0.5 - 1) / 2
SURFACE_COLUMNS = 7
"""x y z, normal x y z, distance from the outline across the line of sight."""
EDGE_COLUMN = 6


@dataclass(frozen=True, slots=True)
class ViewpointConfig:
    """How finely a part is sampled."""

    subdivisions: int = 3
    """Of the icosahedron: 3 gives 642 views, 4 gives M3T's 2562, which track no better."""
    points: int = 300
    """Contour points and surface points a view (ICG: 200, GBOT: 300)."""
    image_size: int = 800
    """Side of the square picture that a view is sampled from, pixels (M3T: 2000)."""
    radius: float = 0.8
    """Distance of the cameras from the part's centre, metres (ICG: 0.8), for parts up to 0.4 m."""
    occlusion_radii: tuple[float, ...] = (0.005, 0.01, 0.02)
    """Radii (metres) for which the part's own nearer surface is noted, for measured occlusion."""
    seed: int = 1000
    """Of where in a view the points begin."""


class Views(NamedTuple):
    """The views around a pose and how near it is to each; shares sum to 1."""

    indices: Int64[np.ndarray, 3]
    shares: Float64[np.ndarray, 3]


@dataclass(frozen=True, slots=True, eq=False)
class ViewpointModel:
    """The views of one part."""

    centre: Vector
    """Middle of the part's bounding box in the part frame; the origin of all points here."""
    directions: Float32[np.ndarray, "v 3"]
    """Unit vector from the camera to the centre, in part axes."""
    contours: Float32[np.ndarray, "v n 8"]
    contour_lengths: ViewNumbers
    """Length of the contour in the plane through the centre, metres; 0 = no contour."""
    contour_offsets: Float32[np.ndarray, "v n r"]
    """How much nearer to the camera the part's own surface comes within each occlusion radius."""
    surfaces: Float32[np.ndarray, "v n 7"]
    surface_areas: ViewNumbers
    """Area of the silhouette in the plane through the centre, square metres."""
    surface_offsets: Float32[np.ndarray, "v n r"]
    occlusion_radii: tuple[float, ...]

    def views(self, T_camera_centre: Transform) -> Views:
        """Return the views around a pose of the part's centre."""
        indices, shares = np.zeros(VIEWS, np.int64), np.zeros(VIEWS)
        nearest_views(self.directions, T_camera_centre, indices, shares)
        return Views(indices, shares)


def build_viewpoint_model(
    mesh: Mesh,
    *,
    config: ViewpointConfig | None = None,
    progress: Callable[[int, int], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> ViewpointModel:
    """Render a part from all sides and sample every view; the same input gives the same model.

    `progress` is told (views done, views); `stop` is asked before every view.

    Raises:
        Stopped: `stop` said so.
    """
    config = config or ViewpointConfig()
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    centre = (low + high) / 2
    reach = float(np.linalg.norm(mesh.vertices - centre, axis=1).max())
    centred = Mesh(np.ascontiguousarray(mesh.vertices - centre), mesh.faces)
    camera = _ViewCamera.around(reach, config)
    directions = sphere_directions(config.subdivisions)
    buffers = raster.new_buffers(camera.size, camera.size)
    views: list[_View] = []
    for k, direction in enumerate(directions):
        if stop is not None and stop():
            raise Stopped("stopped while a viewpoint model was being made")
        views.append(_view(centred, direction, camera, config, buffers, seed=config.seed + k))
        if progress is not None:
            progress(k + 1, len(directions))
    return ViewpointModel(
        centre=centre,
        directions=directions.astype(np.float32),
        contours=np.stack([v.contour for v in views]),
        contour_lengths=np.array([v.length for v in views], np.float32),
        contour_offsets=np.stack([v.contour_offsets for v in views]),
        surfaces=np.stack([v.surface for v in views]),
        surface_areas=np.array([v.area for v in views], np.float32),
        surface_offsets=np.stack([v.surface_offsets for v in views]),
        occlusion_radii=config.occlusion_radii,
    )


def sphere_directions(subdivisions: int) -> Points:
    """Return 10 * 4^subdivisions + 2 even unit vectors: the corners of a subdivided icosahedron."""
    golden = (1 + 5**0.5) / 2
    pairs = [(a, b) for a in (-1.0, 1.0) for b in (-golden, golden)]
    corners = np.array(
        [p for a, b in pairs for p in ((0.0, a, b), (a, b, 0.0), (b, 0.0, a))], np.float64
    )
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    for _ in range(subdivisions):
        # On each level the edges are the pairs nearer than 1.3 times the shortest one.
        square = 2 - 2 * corners @ corners.T
        first, second = np.nonzero(np.triu(square < 1.69 * square[square > 1e-9].min(), 1))
        middles = corners[first] + corners[second]
        middles /= np.linalg.norm(middles, axis=1, keepdims=True)
        corners = np.concatenate([corners, middles])
    return corners


@dataclass(frozen=True, slots=True)
class _ViewCamera:
    radius: float
    focal: float
    middle: float
    size: int

    @staticmethod
    def around(reach: float, config: ViewpointConfig) -> _ViewCamera:
        """A camera that sees a sphere of radius `reach` with a margin of 1 % all round."""
        radius = max(config.radius, 4 * reach)
        half_angle = np.arcsin(reach / radius)
        middle = (config.image_size - 1) / 2
        return _ViewCamera(radius, 0.98 * middle / np.tan(half_angle), middle, config.image_size)


@dataclass(frozen=True, slots=True, eq=False)
class _View:
    contour: Float32[np.ndarray, "n 8"]
    contour_offsets: Float32[np.ndarray, "n r"]
    length: float
    surface: Float32[np.ndarray, "n 7"]
    surface_offsets: Float32[np.ndarray, "n r"]
    area: float


def _view(
    mesh: Mesh,
    direction: Vector,
    camera: _ViewCamera,
    config: ViewpointConfig,
    buffers: tuple[Float32[np.ndarray, "h w"], Int32[np.ndarray, "h w"]],
    *,
    seed: int,
) -> _View:
    """Sample the view of a centred mesh along `direction`; the buffers are drawn over."""
    T = view_transform(direction, camera.radius)
    inverse_depth, faces = buffers
    inverse_depth.fill(0.0)
    faces.fill(-1)
    c = camera.middle
    K = np.array([[camera.focal, 0.0, c], [0.0, camera.focal, c], [0.0, 0.0, 1.0]])
    raster.draw(mesh, T, K=K, inverse_depth=inverse_depth, ids=faces)
    lens = np.array([camera.focal, camera.middle])
    radii = np.array(config.occlusion_radii)
    start = np.random.default_rng(seed).random(3)
    outline, chords = viewpoint_kernels.outline(inverse_depth)
    contour = np.zeros((config.points, CONTOUR_COLUMNS), np.float32)
    contour_offsets = np.zeros((config.points, len(radii)), np.float32)
    if len(outline):
        picked = spread_order(len(outline), config.points, float(start[0]))
        viewpoint_kernels.contour_points(
            outline[picked], chords[picked], inverse_depth, T, lens, radii, contour, contour_offsets
        )
    pixels, count = viewpoint_kernels.spread_pixels(faces, config.points, start[1:])
    surface = np.zeros((config.points, SURFACE_COLUMNS), np.float32)
    surface_offsets = np.zeros((config.points, len(radii)), np.float32)
    if count:
        normals = face_normals(mesh, faces.ravel()[pixels], T)
        edges = viewpoint_kernels.edge_distances(inverse_depth)
        viewpoint_kernels.surface_points(
            pixels, normals, edges, inverse_depth, T, lens, radii, surface, surface_offsets
        )
    pixel = camera.radius / camera.focal
    return _View(
        contour=contour,
        contour_offsets=contour_offsets,
        length=len(outline) * pixel,
        surface=surface,
        surface_offsets=surface_offsets,
        area=count * pixel**2,
    )


def view_transform(direction: Vector, radius: float) -> Transform:
    """Pose T_camera_part of a part seen along the unit vector `direction` from `radius` metres."""
    up = np.array([0.0, 1.0, 0.0]) if abs(direction[1]) < 0.99 else np.array([1.0, 0.0, 0.0])
    x = np.cross(up, direction)
    x /= np.linalg.norm(x)
    R_camera_part = np.stack([x, np.cross(direction, x), direction])
    return transform_from(R_camera_part, np.array([0.0, 0.0, radius]))


def spread_order(available: int, wanted: int, start: float) -> Indices:
    """Pick `wanted` places along a line so that any first few are evenly spread too.

    Multiples of the golden ratio, from `start` (0 to 1) on.
    """
    places = (start + np.arange(wanted) * GOLDEN) % 1.0
    return np.minimum((places * available).astype(np.int64), available - 1)


def face_normals(mesh: Mesh, faces: FaceIndices, T_camera_part: Transform) -> Points:
    """Unit normals of the faces in part axes, turned towards the camera whatever their winding."""
    unit, offsets = face_planes(mesh)
    normals = unit[faces]
    t_part_camera = -T_camera_part[:3, :3].T @ T_camera_part[:3, 3]
    away = normals @ t_part_camera < offsets[faces]
    normals[away] *= -1
    return normals


@lru_cache(maxsize=128)
def face_planes(mesh: Mesh) -> tuple[Points, Float64[np.ndarray, "n"]]:
    """Unit normals of all faces, and how far each one's plane is from the origin along its own."""
    a, b, c = (mesh.vertices[mesh.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return normals, np.einsum("ni,ni->n", normals, a)
