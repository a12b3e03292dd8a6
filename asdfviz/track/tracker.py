"""The tracker: poses of several known parts, carried from frame to frame by colour and depth.

`start` takes the poses of a first frame (from truth, a detector or a person), `update` moves them
to the next frame. Parts may be held together as an assembly's state has them. The tracker only
moves poses; whether they are still right is `confidence`'s to say, and whom to believe its caller's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from asdfviz.datatypes import Camera, Frame, Joint, Mesh, Part, State
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Rgb, Scores, Transform, Transforms, Vector
from asdfviz.geometry.transforms import inverse, transform_from
from asdfviz.track.confidence import Evidence, confidence
from asdfviz.track.links import Link
from asdfviz.track.modalities import Modalities
from asdfviz.track.optimizer import Group
from asdfviz.track.presets import TrackerConfig
from asdfviz.track.viewpoint_model import ViewpointModel
from asdfviz.track.visibility import (
    NO_DEPTH,
    NO_SILHOUETTES,
    MaybeDepth,
    like_regions,
    render_silhouettes,
)

REDRAWN_PX = 0.7
"""Silhouettes are drawn anew when a part may have moved by this many pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """What a tracker needs to know of one part."""

    mesh: Mesh
    model: ViewpointModel
    color: UInt8[np.ndarray, 3]
    """Colour of the real piece (sRGB)."""

    @staticmethod
    def of(part: Part, model: ViewpointModel) -> Body:
        """The body of a part of an assembly."""
        return Body(part.mesh, model, part.color)


class Tracker:
    """Tracks the bodies that `start` gave a pose."""

    def __init__(self, bodies: Mapping[str, Body], camera: Camera, config: TrackerConfig) -> None:
        """Take the bodies by name; all frames must come from `camera`."""
        self.config = config
        self.names: tuple[str, ...] = ()
        """Names of the bodies that are tracked, in the order of all arrays."""
        self._bodies = dict(bodies)
        self._camera = camera
        K = camera.K
        self._lens = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2]])
        self._tracked: list[Modalities] = []
        self._groups: list[Group] = []
        self._Ts_camera_centre: Transforms = np.zeros((0, 4, 4))
        self._meshes: list[Mesh] = []
        self._regions: list[int] = []
        self._reaches: Scores = np.zeros(0)
        self._silhouettes = NO_SILHOUETTES
        self._Ts_drawn: Transforms = np.zeros((0, 4, 4))

    @property
    def poses(self) -> dict[str, Transform]:
        """T_camera_part of every body that is tracked."""
        return {
            name: self._Ts_camera_centre[i] @ _shift(-self._bodies[name].model.centre)
            for i, name in enumerate(self.names)
        }

    def start(self, frame: Frame, poses: Mapping[str, Transform]) -> None:
        """Begin at poses T_camera_part that are known for this frame; forgets all before.

        Raises:
            InputError: a name is not one of the bodies, or the frame does not fit the camera.
        """
        unknown = [name for name in poses if name not in self._bodies]
        if unknown:
            raise InputError(f"no body '{unknown[0]}' to track; bodies: {', '.join(self._bodies)}")
        rgb, _ = self._images(frame)
        self.names = tuple(poses)
        self._Ts_camera_centre = np.stack(
            [np.eye(4), *(poses[n] @ _shift(self._bodies[n].model.centre) for n in self.names)]
        )[1:].copy()
        self._tracked = [
            Modalities(self._bodies[n].model, self._lens, self.config) for n in self.names
        ]
        self._meshes = [_centred(self._bodies[n]) for n in self.names]
        colors = [self._bodies[n].color for n in self.names]
        self._regions = like_regions(colors, nearer_than=self.config.like_colors)
        self._reaches = np.array(
            [np.linalg.norm(mesh.vertices, axis=1).max() for mesh in self._meshes]
        )
        self._silhouettes = NO_SILHOUETTES
        self._Ts_drawn = np.zeros((0, 4, 4))
        self.release()
        for i, tracked in enumerate(self._tracked):
            tracked.start(rgb, self._Ts_camera_centre[i])

    def replace(self, frame: Frame, poses: Mapping[str, Transform]) -> None:
        """Set some tracked bodies to new poses T_camera_part; histograms and links stay.

        A body that is held goes where its base has it.

        Raises:
            InputError: a body is not tracked.
        """
        self._images(frame)
        for name, T_camera_part in poses.items():
            i = self._place(name)
            self._Ts_camera_centre[i] = T_camera_part @ _shift(self._bodies[name].model.centre)
        for group in self._groups:
            group.place(self._Ts_camera_centre)

    def release(self) -> None:
        """Let every body move freely."""
        self._groups = [Group(i, (), self.config.optimizer) for i in range(len(self.names))]

    def hold(self, state: State, *, base: str) -> None:
        """Hold the bodies that a state joins to `base`, with the freedoms of its joints.

        They jump to where the base has them. Bodies that are not tracked are left out; all others
        move freely.

        Raises:
            InputError: the base is not tracked.
        """
        root = self._place(base)
        links: list[Link] = []
        for name in state.attached:
            if name != base and name in self.names:
                member = self.names.index(name)
                joint = state.joints.get(name)
                links.append(self._link(base, name, member, state.T_base_part[name], joint))
        held = {root, *(link.member for link in links)}
        free = [i for i in range(len(self.names)) if i not in held]
        optimizer = self.config.optimizer
        self._groups = [Group(root, links, optimizer), *(Group(i, (), optimizer) for i in free)]
        self._groups[0].place(self._Ts_camera_centre)

    def update(self, frame: Frame) -> dict[str, Transform]:
        """Move all poses to a new frame and return them as T_camera_part.

        Raises:
            InputError: the frame does not fit the camera, or lacks the depth that is asked for.
        """
        rgb, depth = self._images(frame)
        for iteration in range(self.config.correspondence_iterations):
            if self.config.silhouettes:
                self._draw_silhouettes()
            self._correspond(rgb, depth, iteration)
            for update in range(self.config.update_iterations):
                self._step(update)
        self._learn(rgb, depth)
        return self.poses

    def evidence(self, frame: Frame) -> dict[str, Evidence]:
        """What a frame says of the poses as they are now; silhouettes are those last drawn."""
        rgb, depth = self._images(frame)
        return {
            name: self._tracked[i].evidence(
                rgb,
                depth,
                self._Ts_camera_centre[i],
                tolerance=max(4e-3, self.config.confidence.tolerance * float(self._reaches[i])),
                silhouettes=self._silhouettes,
                number=i,
            )
            for i, name in enumerate(self.names)
        }

    def confidence(self, frame: Frame) -> dict[str, float]:
        """Probability, 0 to 1, that each pose as it is now is near the truth of the frame."""
        config = self.config
        return {
            name: confidence(
                seen,
                config.confidence,
                has_color=config.region is not None,
                has_depth=config.depth is not None,
            )
            for name, seen in self.evidence(frame).items()
        }

    def _images(self, frame: Frame) -> tuple[Rgb, MaybeDepth]:
        """The frame's images as the kernels want them."""
        shape = (self._camera.height, self._camera.width)
        if frame.rgb.shape[:2] != shape:
            raise InputError(
                f"frame {frame.index} is {frame.rgb.shape[1]}x{frame.rgb.shape[0]}, "
                f"the tracker's camera {shape[1]}x{shape[0]}"
            )
        if self.config.depth is None:
            return np.ascontiguousarray(frame.rgb), NO_DEPTH
        if frame.depth is None:
            raise InputError(f"frame {frame.index} has no depth, which this tracker needs")
        return np.ascontiguousarray(frame.rgb), np.ascontiguousarray(frame.depth)

    def _place(self, name: str) -> int:
        if name not in self.names:
            raise InputError(f"'{name}' is not tracked; tracked: {', '.join(self.names) or 'none'}")
        return self.names.index(name)

    def _link(
        self, base: str, name: str, member: int, T_base_part: Transform, joint: Joint | None
    ) -> Link:
        """A state's joint, moved from the CAD frames to the centres' frames."""
        c_base, c_part = self._bodies[base].model.centre, self._bodies[name].model.centre
        if joint is not None:
            joint = Joint(
                joint.kind, joint.axis, joint.origin - c_base, slide=joint.slide, turn=joint.turn
            )
        link = Link(member, _shift(-c_base) @ T_base_part @ _shift(c_part), joint)
        T_root = self._Ts_camera_centre[self._place(base)]
        link.adopt(inverse(T_root) @ self._Ts_camera_centre[member])
        return link

    def _draw_silhouettes(self) -> None:
        """Draw anew unless no part has moved by a pixel since."""
        if len(self._Ts_drawn) and self._pixels_moved() < REDRAWN_PX:
            return
        self._Ts_drawn = self._Ts_camera_centre.copy()
        drawn = render_silhouettes(
            self._meshes,
            self._Ts_camera_centre,
            self._camera.K,
            size=self.config.silhouette_px,
            reaches=self._reaches,
            regions=self._regions,
        )
        self._silhouettes = drawn or NO_SILHOUETTES

    def _pixels_moved(self) -> float:
        """Most pixels that any part's rim can have moved since the silhouettes were drawn."""
        change = self._Ts_camera_centre - self._Ts_drawn
        turned = np.abs(change[:, :3, :3]).sum(axis=(1, 2)) * self._reaches / 2
        metres = turned + np.linalg.norm(change[:, :3, 3], axis=1)
        depths = np.maximum(self._Ts_camera_centre[:, 2, 3], 0.01)
        return float((metres * self._lens[0] / depths).max())

    def _correspond(self, rgb: Rgb, depth: MaybeDepth, iteration: int) -> None:
        for i, tracked in enumerate(self._tracked):
            tracked.calculate_correspondences(
                rgb,
                depth,
                self._Ts_camera_centre[i],
                iteration=iteration,
                silhouettes=self._silhouettes,
                number=i,
                region=self._regions[i],
            )

    def _step(self, update: int) -> None:
        for group in self._groups:
            members = group.members
            gradients, hessians = np.zeros((len(members), 6)), np.zeros((len(members), 6, 6))
            for k, i in enumerate(members):
                self._tracked[i].calculate_gradient_and_hessian(
                    self._Ts_camera_centre[i],
                    update=update,
                    gradient=gradients[k],
                    hessian=hessians[k],
                )
            group.step(self._Ts_camera_centre, gradients, hessians)

    def _learn(self, rgb: Rgb, depth: MaybeDepth) -> None:
        for i, tracked in enumerate(self._tracked):
            tracked.learn(
                rgb,
                depth,
                self._Ts_camera_centre[i],
                silhouettes=self._silhouettes,
                region=self._regions[i],
            )


def _centred(body: Body) -> Mesh:
    return Mesh(np.ascontiguousarray(body.mesh.vertices - body.model.centre), body.mesh.faces)


def _shift(by: Vector) -> Transform:
    return transform_from(np.eye(3), by)
