"""Light on a G-buffer: GGX and Lambert under area lights with soft shadows, ambient light with occlusion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float32, Float64
from torch import Tensor
from torch.nn.functional import avg_pool2d, interpolate, pad

from asdfviz.geometry.shapes import Transform, Vector
from asdfviz.geometry.transforms import transform_from
from asdfviz.synth.contact import horizons
from asdfviz.synth.description import Light, Scene
from asdfviz.synth.gbuffer import GBuffer, Views
from asdfviz.synth.mesh_bank import Triangles
from asdfviz.synth.raster import Projected, depth_map
from asdfviz.synth.tensors import box_mean, dot, length, to_tensor, transform_each, unit

WRAP = (1.1, 0.45, 0.35)
"""How far red, green and blue light go round the edge of what is translucent."""
LEAK = (0.85, 0.10, 0.06)
"""Share of red, green and blue light that shines through what is translucent."""
PALE_WRAP = 0.16
"""How far light goes round edges of plastic, by their albedo: it enters plastic and is thrown back and
forth in grooves too narrow for shadow maps."""
LOWEST_OCCLUDED = -0.2
"""Height, metres, below which nothing is occluded by what stands on the table."""


@dataclass(frozen=True, slots=True)
class ShadingConfig:
    """Cost against quality of the light."""

    interleave: int = 3
    """Every block of so many pixels a side shares as many points of an area light as it has pixels;
    each pixel tests one of them, and neighbours are averaged."""
    occlusion: float = 1.0
    """Strength of the darkening in corners and round things that stand close."""
    shadow_pixels: int = 448
    """Side of a shadow map."""
    directions: int = 8
    """In which close surfaces are looked for that keep light off; 0 = none."""
    bias: float = 0.0022
    """Metres by which a surface is lifted along its normal before it is tested."""


def look_at(eye: Vector, target: Vector, *, roll: float = 0.0) -> Transform:
    """T_camera_world of a camera at `eye` whose optical axis meets `target`."""
    z = (target - eye) / np.linalg.norm(target - eye)
    up = np.array([np.sin(roll), np.cos(roll), 0.0])
    x = np.cross(z, up)
    if np.linalg.norm(x) < 1e-6:
        x = np.cross(z, np.array([1.0, 0.0, 0.3]))
    x /= np.linalg.norm(x)
    R_world_camera = np.stack([x, np.cross(z, x), z], axis=1)
    return transform_from(R_world_camera.T, -R_world_camera.T @ eye)


def shade(
    scenes: Sequence[Scene],
    triangles: Triangles,
    buffer: GBuffer,
    views: Views,
    *,
    rng: np.random.Generator,
    config: ShadingConfig,
) -> Float32[Tensor, "b h w 3"]:
    """Radiance at every pixel, linear RGB. `rng` places the samples on the area lights."""
    device = buffer.depth.device
    total = torch.zeros_like(buffer.albedo)
    wrap = _wrapped(buffer)
    near = horizons(buffer, views, directions=config.directions) if config.directions else None
    for k in range(max(len(s.lights) for s in scenes)):
        lights = [s.lights[min(k, len(s.lights) - 1)] for s in scenes]
        on = torch.tensor([float(k < len(s.lights)) for s in scenes], device=device)
        visible = _visibility(scenes, lights, triangles, buffer, rng, config)
        if near is not None:
            visible = visible.minimum(near.light(_tensor([l.position for l in lights], device)))
        color = (
            _tensor([light.color for light in lights], device)[:, None, None]
            * on[:, None, None, None]
        )
        total += color * _reflect(buffer, lights, wrap) * _through(visible, buffer.translucency)
    sky = ambient_occlusion(buffer.depth, strength=config.occlusion)
    return total + _ambient(scenes, buffer, sky if near is None else sky * near.sky())


def _through(
    visible: Float32[Tensor, "b h w"], translucency: Float32[Tensor, "b h w"]
) -> Float32[Tensor, "b h w 3"]:
    """Light that arrives, by colour: red goes some way through skin into its shadows."""
    leak = translucency[..., None] * visible.new_tensor(LEAK)
    return visible[..., None] + (1 - visible[..., None]) * leak


def _tensor(rows: Sequence[np.ndarray], device: torch.device) -> Tensor:
    return to_tensor(np.stack(rows), device, dtype=torch.float32)


def _visibility(
    scenes: Sequence[Scene],
    lights: Sequence[Light],
    triangles: Triangles,
    buffer: GBuffer,
    rng: np.random.Generator,
    config: ShadingConfig,
) -> Float32[Tensor, "b h w"]:
    """Share of each area light that each pixel sees."""
    side, n = config.shadow_pixels, config.interleave
    count = len(buffer.depth)
    # The grounds cast no shadow, so that theirs need no distance and reach what throws them.
    lifted = buffer.position + buffer.normal * (config.bias * (buffer.owner >= 0))[..., None]
    visible = torch.empty_like(buffer.depth)
    image = torch.arange(count, device=visible.device)[:, None, None] * (side * side)
    turn = rng.random() * 2 * np.pi
    for k in range(n * n):
        # A spiral of golden angles fills the disc evenly, whatever the number of its points.
        radius, angle = np.sqrt((k + 0.5) / (n * n)), turn + k * 2.39996
        disc = radius * np.array([np.cos(angle), np.sin(angle)])
        M = _light_cameras(scenes, lights, disc, side, visible.device)
        blocked = _cast(triangles, M, (count, side, side)).view(-1)
        # 7 steps through the block visit its pixels in an order unlike the spiral's.
        row, column = divmod(7 * k % (n * n), n)
        some = lifted[:, row::n, column::n]
        shape = some.shape[:3]
        noise = to_tensor((rng.random((2, *shape[1:])) - 0.5) * 1.6, visible.device).float()
        x, y, z = (
            (M[:, :, :3] @ some.reshape(count, -1, 3).transpose(1, 2) + M[:, :, 3:])
            .view(count, 3, *shape[1:])
            .unbind(1)
        )
        u, v = (
            (c / z + noise[i] + side / 2).round_().clamp_(0, side - 1).long()
            for i, c in enumerate((x, y))
        )
        visible[:, row::n, column::n] = (z < blocked[image + v * side + u] + 0.0008).float()
    soft = visible[:, None]
    for window in (n + 1 - n % 2, 3):
        soft = avg_pool2d(soft, window, stride=1, padding=window // 2, count_include_pad=False)
    return soft[:, 0]


def _cast(
    triangles: Triangles, M: Float32[Tensor, "b 3 4"], shape: tuple[int, int, int]
) -> Float32[Tensor, "b h w"]:
    """Depth of the nearest surface from each light camera."""
    x, y, z = transform_each(M, triangles.vertices, triangles.vertex_image)
    points_px = torch.stack([x, y], dim=1) / z.clamp(min=1e-3)[:, None] + shape[2] / 2
    return depth_map(Projected(points_px, z, triangles.faces, triangles.image), shape)


def _light_cameras(
    scenes: Sequence[Scene],
    lights: Sequence[Light],
    disc: Float64[np.ndarray, "2"],
    side: int,
    device: torch.device,
) -> Float32[Tensor, "b 3 4"]:
    """K T_camera_world (centre at pixel 0) of one point of each light's disc, looking at the scene."""
    rows: list[np.ndarray] = []
    for scene, light in zip(scenes, lights, strict=True):
        axes = look_at(light.position, scene.target, roll=0.3)[:2, :3]
        eye = light.position + light.radius * disc @ axes
        focal = side / 2 * float(np.linalg.norm(eye - scene.target)) / scene.reach
        rows.append(np.diag([focal, focal, 1.0]) @ look_at(eye, scene.target, roll=0.3)[:3])
    return _tensor(rows, device)


def _wrapped(buffer: GBuffer) -> Float32[Tensor, "b h w 3"]:
    """How far light of each colour goes round edges."""
    wrap = buffer.translucency[..., None] * buffer.albedo.new_tensor(WRAP)
    plastic = (buffer.owner >= 0) & (buffer.translucency == 0)
    return wrap.addcmul_(buffer.albedo, plastic[..., None].float(), value=PALE_WRAP)


def _reflect(
    buffer: GBuffer, lights: Sequence[Light], wrap: Float32[Tensor, "b h w 3"]
) -> Float32[Tensor, "b h w 3"]:
    """Lambert plus the GGX lobe of a dielectric, for an irradiance of pi from each light's centre."""
    position = _tensor([light.position for light in lights], buffer.depth.device)
    towards = position[:, None, None] - buffer.position
    distance = length(towards)
    fall = (length(position)[:, None, None] / distance).square()
    direction = towards / distance
    cosine = dot(buffer.normal, direction)[..., 0]
    diffuse = ((cosine[..., None] + wrap) / (1 + wrap)).clamp(min=0)
    half = unit(direction + buffer.view)
    n_half = dot(buffer.normal, half)[..., 0].clamp(0, 1)
    l_half = dot(direction, half)[..., 0].clamp(0.1, 1)
    # A wide light widens the lobe (Karis, "Real shading in Unreal Engine 4", 2013).
    width = _tensor([np.array(light.radius) for light in lights], distance.device)[:, None, None]
    widened = buffer.roughness.square().clamp(min=0.03) + 0.5 * width / distance[..., 0]
    alpha = widened.clamp(max=1.0).square()
    lobe = alpha / (np.pi * (n_half.square() * (alpha - 1) + 1).square())
    # Shadowing and masking as in Kelemen and Szirmay-Kalos (2001); Schlick's Fresnel term.
    fresnel = 0.04 + 0.96 * _fifth(1 - l_half)
    gloss = np.pi * fresnel * lobe * cosine.clamp(min=0) / (4 * l_half.square())
    return (buffer.albedo * diffuse + gloss[..., None]) * fall


def _fifth(share: Tensor) -> Tensor:
    """The fifth power; torch's own takes five times as long."""
    square = share.square()
    return square.square().mul_(share)


def _on_the_ground(scene: Scene) -> Vector:
    """Light of each colour that arrives on open ground: the sky's and the lamps'."""
    slopes = [max(0.0, float(l.position[2] / np.linalg.norm(l.position))) for l in scene.lights]
    lamps = [slope * light.color for slope, light in zip(slopes, scene.lights, strict=True)]
    return np.sum([scene.sky, *lamps], axis=0)


def _ambient(
    scenes: Sequence[Scene], buffer: GBuffer, open_sky: Float32[Tensor, "b h w"]
) -> Float32[Tensor, "b h w 3"]:
    """Light from all around: sky above, what the ground throws back below, less in corners."""
    device = buffer.depth.device
    sky = _tensor([s.sky for s in scenes], device)[:, None, None]
    tint = _tensor([s.tint for s in scenes], device)[:, None, None]
    ground = _tensor([_on_the_ground(s) for s in scenes], device)[:, None, None]
    bounced = ground * buffer.albedo.mean(dim=(1, 2), keepdim=True)
    upward = 0.5 + 0.5 * buffer.normal[..., 2:]
    light = (sky * upward + bounced * (1 - upward)) * (1 + dot(buffer.normal, tint)).clamp(min=0.2)
    # The floor lies too far below the table to be darkened by it.
    deep = buffer.position[..., 2] < LOWEST_OCCLUDED
    occlusion = torch.where(deep, 1.0, open_sky)
    n_view = dot(buffer.normal, buffer.view).clamp(0, 1)
    fresnel = 0.04 + 0.5 * _fifth(1 - n_view) * (1 - buffer.roughness[..., None])
    mirrored = 2 * n_view * buffer.normal - buffer.view
    # What is mirrored: a ceiling brighter on one side, walls, and the ground below.
    room = (0.25 + 0.9 * mirrored[..., 2:]).clamp(min=0.05)
    room = sky * room * (1 + 2.5 * dot(mirrored, tint)).clamp(min=0.3)
    room = torch.lerp(room, bounced.expand_as(room), (-3 * mirrored[..., 2:]).clamp(0, 1))
    dark = occlusion[..., None]
    through = _through(occlusion, buffer.translucency).maximum(interreflected(dark, buffer.albedo))
    return light * buffer.albedo * through + room * fresnel * dark.square()


def interreflected(
    visible: Float32[Tensor, "b h w 1"], albedo: Float32[Tensor, "b h w 3"]
) -> Float32[Tensor, "b h w 3"]:
    """Ambient light in corners whose own walls throw light at each other, most where they are pale.

    The cubic fit of Jimenez et al., "Practical real-time strategies for accurate indirect occlusion"
    (2016).
    """
    a, b, c = 2.0404 * albedo - 0.3324, 0.6417 - 4.7951 * albedo, 2.7552 * albedo + 0.6903
    return ((a * visible + b) * visible + c) * visible


def ambient_occlusion(
    depth: Float32[Tensor, "b h w"], *, strength: float = 1.0
) -> Float32[Tensor, "b h w"]:
    """Darkness of places that lie deeper than their surroundings, at three sizes."""
    height, width = depth.shape[1:]
    small = interpolate(depth[:, None], size=(height // 4, width // 4), mode="area")
    total = torch.ones_like(depth)
    for reach, power in ((0.006, 9.0), (0.016, 7.0), (0.04, 5.0)):
        radius = max(1, round(reach * width / 4))
        soft = _continued(small, 2 * radius)
        for _ in range(2):
            soft = box_mean(soft, radius)
        large = interpolate(soft, size=(height, width), mode="bilinear")[:, 0]
        total *= torch.exp(-strength * power * (depth - large).clamp(0, 0.08))
    return total


def _continued(image: Float32[Tensor, "b 1 h w"], border: int) -> Float32[Tensor, "b 1 h2 w2"]:
    """Continue an image point-symmetrically about its border, so that slopes go on."""
    border = min(border, image.shape[2] - 1, image.shape[3] - 1)
    size = (border, border, border, border)
    return 2 * pad(image, size, mode="replicate") - pad(image, size, mode="reflect")
