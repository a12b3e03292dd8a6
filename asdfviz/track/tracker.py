"""The tracker: poses of several known parts, carried from frame to frame by colour and depth.

`start` takes the poses of a first frame, `update` moves them to the next one. Parts may be held
together as a state has them. Whether poses are still right is `confidence`'s to say.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from asdfviz.datatypes import Camera, Frame, Joint, State
from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Rgb, Transform, Transforms, Vector
from asdfviz.geometry.transforms import inverse, transform_from
from asdfviz.track.bodies import Body
from asdfviz.track.confidence import Evidence, confidence, depth_tolerance
from asdfviz.track.frame_images import fitting_images
from asdfviz.track.links import Link
from asdfviz.track.modalities import Modalities
from asdfviz.track.optimizer import Group
from asdfviz.track.presets import TrackerConfig
from asdfviz.track.silhouettes import DrawnParts
from asdfviz.track.starts import Trial, settle
from asdfviz.track.visibility import NO_SILHOUETTES, MaybeDepth, Silhouettes


class Tracker:
    """Tracks the bodies that `start` gave a pose."""

    def __init__(self, bodies: Mapping[str, Body], camera: Camera, config: TrackerConfig) -> None:
        """Take the bodies by name; all frames must come from `camera`."""
        self.config = config
        self.names: tuple[str, ...] = ()
        """Names of the bodies that are tracked, in the order of all arrays."""
        self._bodies = dict(bodies)
        self._camera = camera
        self._lens = camera.K[[0, 1, 0, 1], [0, 1, 2, 2]]
        self._tracked: list[Modalities] = []
        self._groups: list[Group] = []
        self._Ts_camera_centre: Transforms = np.zeros((0, 4, 4))
        self._drawn = DrawnParts((), camera.K, config)

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
        self.names, self._tracked = (), []
        self._Ts_camera_centre = np.zeros((0, 4, 4))
        self.add(frame, poses)

    def add(self, frame: Frame, poses: Mapping[str, Transform]) -> None:
        """Track further bodies from poses T_camera_part of this frame; all bodies move freely then.

        Raises:
            InputError: a name is not one of the bodies or tracked already, or the frame does not
                fit the camera.
        """
        rgb, depth = self._images(frame)
        for name, T_camera_part in poses.items():
            if name not in self._bodies:
                known = ", ".join(self._bodies)
                raise InputError(f"no body '{name}' to track; bodies: {known}")
            if name in self.names:
                raise InputError(f"'{name}' is tracked already")
            T = T_camera_part @ _shift(self._bodies[name].model.centre)
            tracked = Modalities(self._bodies[name].model, self._lens, self.config)
            tracked.start(rgb, depth, T)
            self._tracked.append(tracked)
            self._Ts_camera_centre = np.concatenate([self._Ts_camera_centre, T[None]])
        self.names = (*self.names, *poses)
        self._regroup()

    def drop(self, names: Collection[str]) -> None:
        """Track these bodies no longer; all others move freely then."""
        kept = [i for i, name in enumerate(self.names) if name not in names]
        self._tracked = [self._tracked[i] for i in kept]
        self._Ts_camera_centre = self._Ts_camera_centre[kept].copy()
        self.names = tuple(self.names[i] for i in kept)
        self._regroup()

    def _regroup(self) -> None:
        bodies = [self._bodies[name] for name in self.names]
        self._drawn = DrawnParts(bodies, self._camera.K, self.config)
        self.release()

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

    def forget_colors(self, name: str) -> None:
        """Learn the surface's colours anew, as a tracked body is another thing than before."""
        colors = self._tracked[self._place(name)].colors
        if colors is not None:
            colors.forget()

    def begin_colors(self, frame: Frame, name: str) -> None:
        """Learn all colours of a body anew at the pose that it has; links stay, raises as `learn` does."""
        rgb, depth = self._images(frame)
        i = self._place(name)
        self.forget_colors(name)
        self._tracked[i].start(rgb, depth, self._Ts_camera_centre[i])

    def release(self) -> None:
        """Let every body move freely."""
        self._drawn.hold(())
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
        self._drawn.hold(held)
        optimizer = self.config.optimizer
        self._groups = [Group(root, links, optimizer), *(Group(i, (), optimizer) for i in free)]
        self._groups[0].place(self._Ts_camera_centre)

    def update(self, frame: Frame) -> dict[str, Transform]:
        """Move all poses to a new frame, learn its colours, and return the poses T_camera_part.

        Raises:
            InputError: the frame does not fit the camera, or lacks the depth that is asked for.
        """
        self.move(frame)
        self.learn(frame, self.names)
        return self.poses

    def move(self, frame: Frame) -> None:
        """Move all poses to a new frame without learning its colours; raises as `update` does."""
        rgb, depth = self._images(frame)
        for iteration in range(self.config.correspondence_iterations):
            self._drawn.refresh(self._Ts_camera_centre)
            self._correspond(rgb, depth, iteration)
            for update in range(self.config.update_iterations):
                self._step(update)

    def learn(self, frame: Frame, names: Collection[str]) -> None:
        """Let these bodies learn their colours at the poses that they have now.

        Raises:
            InputError: a body is not tracked, or the frame does not fit.
        """
        rgb, depth = self._images(frame)
        Ts, drawn = self._Ts_camera_centre, self._drawn
        for i in map(self._place, names):
            self._tracked[i].learn(
                rgb, depth, Ts[i], silhouettes=drawn.of(i), number=i, region=drawn.regions[i]
            )

    def evidence(self, frame: Frame) -> dict[str, Evidence]:
        """What a frame says of the poses as they are now."""
        rgb, depth = self._images(frame)
        self._drawn.refresh(self._Ts_camera_centre)
        return {
            name: self._seen(rgb, depth, i, self._Ts_camera_centre[i], self._drawn.of(i))
            for i, name in enumerate(self.names)
        }

    def confidence(self, frame: Frame) -> dict[str, float]:
        """Probability, 0 to 1, that each pose as it is now is near the truth of the frame."""
        return {name: self.judged(seen) for name, seen in self.evidence(frame).items()}

    def trials(
        self, frame: Frame, name: str, starts: Sequence[Transform], *, rounds: int | None = None
    ) -> list[Trial]:
        """Settle one tracked body from several poses T_camera_part; nothing is moved.

        Links do not hold here, and no silhouettes are asked: they show where the body was. Fewer
        `rounds` than the config's correspondence iterations leave out the finest ones.

        Raises:
            InputError: the body is not tracked, or the frame does not fit.
        """
        rgb, depth = self._images(frame)
        i, config = self._place(name), self.config
        tracked, centre = self._tracked[i], self._bodies[name].model.centre
        count, sharp = rounds or config.correspondence_iterations, config.confidence.sharp
        found: list[Trial] = []
        for T_camera_part in starts:
            start = T_camera_part @ _shift(centre)
            T = settle(tracked, rgb, depth, start, config=config, rounds=count)
            seen = self._seen(rgb, depth, i, T, NO_SILHOUETTES)
            close = tracked.close_fit(depth, T, sharp)
            shown = seen if config.colors.choose else seen._replace(alike=None)
            found.append(Trial(T @ _shift(-centre), shown, self.judged(seen), close))
        return found

    def _seen(
        self,
        rgb: Rgb,
        depth: MaybeDepth,
        i: int,
        T_camera_centre: Transform,
        silhouettes: Silhouettes,
    ) -> Evidence:
        return self._tracked[i].evidence(
            rgb,
            depth,
            T_camera_centre,
            tolerance=depth_tolerance(self.config.confidence, float(self._drawn.reaches[i])),
            silhouettes=silhouettes,
            number=i,
        )

    def judged(self, seen: Evidence) -> float:
        """Probability, 0 to 1, that a pose with this evidence is near the truth."""
        return confidence(
            seen,
            self.config.confidence,
            has_color=self.config.region is not None,
            has_depth=self.config.depth is not None,
        )

    def _images(self, frame: Frame) -> tuple[Rgb, MaybeDepth]:
        """The frame's images as the kernels want them."""
        return fitting_images(frame, self._camera, with_depth=self.config.depth is not None)

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
            joint = replace(joint, origin=joint.origin - c_base)
        link = Link(member, _shift(-c_base) @ T_base_part @ _shift(c_part), joint)
        T_root = self._Ts_camera_centre[self._place(base)]
        T_root_member = inverse(T_root) @ self._Ts_camera_centre[member]
        link.adopt(T_root_member, self._bodies[name].symmetries)
        return link

    def _correspond(self, rgb: Rgb, depth: MaybeDepth, iteration: int) -> None:
        for i, tracked in enumerate(self._tracked):
            tracked.calculate_correspondences(
                rgb,
                depth,
                self._Ts_camera_centre[i],
                iteration=iteration,
                silhouettes=self._drawn.of(i),
                number=i,
                region=self._drawn.regions[i],
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


def _shift(by: Vector) -> Transform:
    return transform_from(np.eye(3), by)
