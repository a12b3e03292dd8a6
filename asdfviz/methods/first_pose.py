"""First poses of parts from crops around their boxes: hypotheses of rotation, settled by outline and depth.

Ours, not the paper's: its first poses come from keypoints alone. Imports torch only when the
network is loaded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal, Protocol, TypeAlias, runtime_checkable

import cv2
import numpy as np

from asdfviz.datatypes import Assembly, Detection, Frame, PoseEstimate
from asdfviz.detector.crop_answer import CropAnswer
from asdfviz.detector.crop_classes import class_name
from asdfviz.errors import WeightsError
from asdfviz.geometry.rotation_grid import rotations_of
from asdfviz.geometry.sampling import hull_corners, oriented_surface_points, surface_middle
from asdfviz.geometry.shapes import Box, Intrinsics, Points, Rgb
from asdfviz.geometry.threads import side_by_side
from asdfviz.methods.looked_at import Before, LookedAt
from asdfviz.methods.network import shipped_weights
from asdfviz.methods.seen_table import table_near
from asdfviz.pose.box_fit import is_cut_off
from asdfviz.pose.hypotheses import Candidates, HypothesisConfig, settle
from asdfviz.pose.part_view import PartView, Surface, sampled_depth
from asdfviz.pose.table import SunkConfig

FirstPose: TypeAlias = Literal["keypoints", "hypotheses"]
"""What the first pose of a part comes from."""
CROP_WEIGHTS = "crops.safetensors"
"""File beside assembly.yaml, or one folder up, that methods use unless told otherwise."""
CELLS = 40
"""Side of the view in which hypotheses are compared, cells."""
SURFACE_POINTS = 1500
"""Points that stand for a part's surface there."""
BORDER_PX = 3.0
"""A box that comes this near to the image's border is cut off and says nothing of size."""


@runtime_checkable
class LooksAtParts(Protocol):
    """Anything that proposes rotations of parts in boxes."""

    @property
    def classes(self) -> tuple[str, ...]:
        """The classes that it knows, of parts and groups."""
        ...

    @property
    def states(self) -> Mapping[str, tuple[str, ...]]:
        """Of every group that it knows, the states that it tells apart."""
        ...

    def look(
        self, rgb: Rgb, K: Intrinsics, boxes: Mapping[str, tuple[str, Box]]
    ) -> Mapping[str, CropAnswer]:
        """Look at parts: for each its class and its box."""
        ...


@dataclass(frozen=True)
class CropPoseConfig:
    """First poses and the state's looks from crops."""

    weights: Path | None = None
    """Trained crop weights (.safetensors). Default: crops.safetensors in the assembly's folder, or
    in the folder above."""
    state_weights: Path | None = None
    """Likewise of the state network. Default: states.safetensors there."""
    device: str = "cpu"
    """Torch device, such as cpu or cuda."""
    bfloat16: bool = True
    """Run these networks in bfloat16 where the device has it: faster, rotations hardly change."""
    hypotheses: HypothesisConfig = field(default_factory=HypothesisConfig)
    """How rotations are scored and refined."""


def crop_weights_path(config: CropPoseConfig, assembly: Assembly) -> Path:
    """Return the file that the crop network is read from; it need not exist."""
    if config.weights is not None:
        return config.weights.expanduser().resolve()
    return shipped_weights(assembly, CROP_WEIGHTS)


def chosen_first_pose(
    first_pose: FirstPose | None, config: CropPoseConfig, assembly: Assembly
) -> FirstPose:
    """What first poses come from; left open, hypotheses where crop weights are there or named."""
    if first_pose is not None:
        return first_pose
    has_weights = config.weights is not None or crop_weights_path(config, assembly).is_file()
    return "hypotheses" if has_weights else "keypoints"


def load_looker(config: CropPoseConfig, assembly: Assembly) -> LooksAtParts:
    """Load the crop network for an assembly.

    Raises:
        InputError: the device is not there.
        WeightsError: there are no weights, or they know none of the assembly's parts.
    """
    path = crop_weights_path(config, assembly)
    from asdfviz.detector.crop_looker import CropLooker, CropLookerConfig
    from asdfviz.detector.device import require_device

    require_device(config.device)
    running = CropLookerConfig(config.hypotheses.count, config.device, config.bfloat16)
    looker = CropLooker(path, config=running)
    wanted = {class_name(assembly, assembly.parts[name]) for name in assembly.parts}
    if not wanted & set(looker.classes):
        raise WeightsError(
            f"{path} knows none of the parts of '{assembly.name}': it has "
            f"{', '.join(looker.classes)}; the assembly needs {', '.join(sorted(wanted))}"
        )
    return looker


@dataclass(frozen=True, slots=True, eq=False)
class CropPoses:
    """First poses of an assembly's parts from crops."""

    assembly: Assembly
    looker: LooksAtParts
    surfaces: Mapping[str, Surface]
    middles: Mapping[str, Points]
    """(1, 3) `surface_middle` of every part."""
    config: HypothesisConfig
    sunk: SunkConfig | None = None
    """What it means to stand in the table; None: nothing."""

    @classmethod
    def of(
        cls,
        assembly: Assembly,
        looker: LooksAtParts,
        *,
        config: HypothesisConfig,
        sunk: SunkConfig | None = None,
    ) -> CropPoses:
        """Sample the parts' surfaces."""
        surfaces: dict[str, Surface] = {}
        middles: dict[str, Points] = {}
        for name, part in assembly.parts.items():
            mesh = part.mesh
            points, normals = oriented_surface_points(mesh.vertices, mesh.faces, SURFACE_POINTS)
            surfaces[name] = Surface(points, normals, hull_corners(mesh.vertices), mesh.middle)
            middles[name] = surface_middle(mesh.vertices, mesh.faces)[None]
        return cls(assembly, looker, surfaces, middles, config, sunk)

    def poses(
        self,
        found: Mapping[str, Detection],
        frame: Frame,
        *,
        use_depth: bool,
        previous: Mapping[str, Before] | None = None,
    ) -> dict[str, PoseEstimate]:
        """The pose of every detected part on which outline (and depth) agree; others are absent.

        A pose's score is that of its box times how well it agrees.

        Args:
            found: detections by part.
            frame: with depth, if that is used.
            use_depth: whether measured depth has a say.
            previous: poses of the frame before, as further hypotheses.
        """
        return best_settled(
            self.looked_at(found, frame, use_depth=use_depth, previous=previous), found
        )

    def looked_at(
        self,
        found: Mapping[str, Detection],
        frame: Frame,
        *,
        use_depth: bool,
        previous: Mapping[str, Before] | None = None,
    ) -> dict[str, LookedAt]:
        """As `poses`, with the runners-up of every part that has a pose, and the answers."""
        boxes = {
            name: (class_name(self.assembly, self.assembly.parts[name]), d.box_xyxy)
            for name, d in found.items()
        }
        answers = self.looker.look(frame.rgb, frame.camera.K, boxes)
        before, parts = previous or {}, self.assembly.parts
        views = {
            name: self._view(answer, found[name].box_xyxy, frame, use_depth=use_depth)
            for name, answer in answers.items()
        }
        settled = side_by_side(
            lambda name: settle(
                self._candidates(
                    name, answers[name], found[name].box_xyxy, frame, before.get(name)
                ),
                self.surfaces[name],
                views[name],
                config=self.config,
                sunk=self.sunk,
            ),
            answers,
        )
        return {
            name: LookedAt(tuple(best), answers[name], found[name], parts[name].symmetries)
            for name, best in zip(answers, settled, strict=True)
            if best
        }

    def _view(
        self, answer: CropAnswer, box_xyxy: Box, frame: Frame, *, use_depth: bool
    ) -> PartView:
        view = _view(answer, box_xyxy, frame, use_depth=use_depth)
        table = table_near(frame, box_xyxy) if use_depth and self.sunk else None
        return view if table is None else replace(view, table=table.seen_from(view.R_camera_view))

    def _candidates(
        self, name: str, answer: CropAnswer, box_xyxy: Box, frame: Frame, before: Before | None
    ) -> Candidates:
        """The rotation of before and the network's; where the box is cut off, with its guess of the distance."""
        turns, probabilities = rotations_of(answer.rotations), answer.probabilities
        part = self.assembly.parts[name]
        if before is not None:
            R_before = before.T_camera_part[:3, :3]
            now = answer.likelihood(R_before, part.symmetries)
            likely = max(before.liked, now) * probabilities[0]
            turns = np.concatenate([(answer.camera.R_camera_crop.T @ R_before)[None], turns])
            probabilities = np.concatenate([[likely], probabilities])
        distances = np.full(len(turns), np.nan)
        if is_cut_off(box_xyxy, (frame.camera.width, frame.camera.height), BORDER_PX):
            guess = answer.distance(part.diameter)
            distances[:] = guess - (self.middles[name] @ turns.transpose(0, 2, 1))[:, 0, 2]
        return Candidates(answer.camera.R_camera_crop @ turns, probabilities, distances)


def crop_poses(
    first_pose: FirstPose | None,
    config: CropPoseConfig,
    assembly: Assembly,
    *,
    looker: LooksAtParts | None = None,
    sunk: SunkConfig | None = None,
) -> CropPoses | None:
    """What gives first poses from crops, or None where keypoints are chosen.

    Args:
        first_pose: the option; None chooses hypotheses where crop weights are there or named.
        config: of the crops.
        assembly: gives parts and the place of the weights.
        looker: used instead of the configured network.
        sunk: what it means to stand in the table; None: nothing.

    Raises:
        WeightsError: there are no weights, or they do not fit.
    """
    is_open = first_pose is None and looker is not None
    if not is_open and chosen_first_pose(first_pose, config, assembly) == "keypoints":
        return None
    chosen = looker or load_looker(config, assembly)
    return CropPoses.of(assembly, chosen, config=config.hypotheses, sunk=sunk)


def best_settled(
    looked_at: Mapping[str, LookedAt], found: Mapping[str, Detection]
) -> dict[str, PoseEstimate]:
    """The winners; a score is that of the box times how well the pose agrees."""
    poses: dict[str, PoseEstimate] = {}
    for name, look in looked_at.items():
        best = look.settled[0]
        score = found[name].score * best.agreement
        poses[name] = PoseEstimate(name, best.T_camera_part, score, "crop")
    return poses


def _view(answer: CropAnswer, box_xyxy: Box, frame: Frame, *, use_depth: bool) -> PartView:
    """What is seen of a part, in cells of the crop."""
    K, camera = frame.camera.K, answer.camera
    focal = float(camera.K[0, 0]) * CELLS / (2 * float(camera.K[0, 2]) + 1)
    outline = cv2.resize(answer.outline, (CELLS, CELLS), interpolation=cv2.INTER_LINEAR)
    measured = np.zeros((CELLS, CELLS))
    if use_depth and frame.depth is not None:
        measured = sampled_depth(frame.depth, K, camera.R_camera_crop, focal=focal, side=CELLS)
    x0, y0, x1, y1 = box_xyxy
    corners = np.array([[x0, y0, 1.0], [x1, y0, 1.0], [x1, y1, 1.0], [x0, y1, 1.0]])
    rays = corners @ np.linalg.inv(K).T @ camera.R_camera_crop
    flat = focal * rays[:, :2] / rays[:, 2:] + (CELLS - 1) / 2
    # Off the axis the box's sides are a little askew in the view: the mean of opposite ones.
    box = np.array(
        [
            flat[[0, 3], 0].mean(),
            flat[[0, 1], 1].mean(),
            flat[[1, 2], 0].mean(),
            flat[[2, 3], 1].mean(),
        ]
    )
    return PartView(focal, camera.R_camera_crop, np.asarray(outline, np.float64), measured, box)
