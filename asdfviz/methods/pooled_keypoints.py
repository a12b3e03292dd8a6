"""One pose for a joined group from the keypoints of all its parts.

Not in the paper. A part's seventeen keypoints lie close together, and say little of its tilt; those of
all parts that the state joins span the whole group. They are solved as those of one body in the base's
frame, which is moved along its viewing ray as depth asks of the parts in the median.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from asdfviz.datatypes import Assembly, Detection, Frame, PoseEstimate
from asdfviz.geometry.boxes import box_around, diagonal
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import apply, transform_from
from asdfviz.methods.part_poses import PartShape
from asdfviz.pose.pnp import PnpConfig, PnpSolution, solve_pnp
from asdfviz.pose.translation import TranslationConfig, refine_translation

PooledBase: TypeAlias = Callable[[Mapping[str, Transform]], PoseEstimate | None]
"""The base's pose by the keypoints of parts, given where the state has them, T_base_part."""

FEWEST_PARTS = 2
"""One part's keypoints have given its own pose already."""


class PooledKeypoints:
    """Solves the joined parts of one assembly."""

    def __init__(
        self,
        assembly: Assembly,
        shapes: Mapping[str, PartShape],
        pnp: PnpConfig,
        translation: TranslationConfig,
    ) -> None:
        """Keep what is solved.

        Args:
            assembly: whose parts.
            shapes: of the parts.
            pnp: thresholds and solver; shares of a box's diagonal are those of the mean part's.
            translation: how depth moves a part along its ray (section 3.1.1).
        """
        self._assembly, self._shapes = assembly, shapes
        self._pnp, self._translation = pnp, translation

    def base(
        self, T_base_parts: Mapping[str, Transform], *, found: Mapping[str, Detection], frame: Frame
    ) -> PoseEstimate | None:
        """The base where the keypoints of all joined parts that were detected put it.

        Args:
            T_base_parts: where the state has the parts.
            found: the parts' boxes, with keypoints.
            frame: with depth, or distances stay as keypoints have them.

        Returns:
            None where fewer than two of the parts were detected, or too few keypoints agree.
        """
        parts = self._assembly.parts
        # In which of several turns keypoints are labelled says nothing of the group's.
        names = [n for n in T_base_parts if n in found and not parts[n].symmetries.is_symmetric]
        if len(names) < FEWEST_PARTS:
            return None
        solution = self._solved(names, T_base_parts, found, frame)
        if solution is None:
            return None
        T_base, factors = solution.T_camera_part, list[float]()
        for name in names:
            T_camera_part = T_base @ T_base_parts[name]
            T_moved = refine_translation(
                T_camera_part,
                self._shapes[name].surface,
                box_xyxy=found[name].box_xyxy,
                depth=frame.depth,
                K=frame.camera.K,
                config=self._translation,
            )
            if T_moved is not None:
                factors.append(float(T_moved[2, 3] / T_camera_part[2, 3]))
        farther = float(np.median(factors)) if factors else 1.0
        keypoints = sum(len(found[name].keypoints_px) for name in names)
        sure = float(np.mean([found[name].score for name in names]))
        T_moved = transform_from(T_base[:3, :3], T_base[:3, 3] * farther)
        return PoseEstimate(
            self._assembly.base, T_moved, sure * solution.inliers / keypoints, "group"
        )

    def _solved(
        self,
        names: list[str],
        T_base_parts: Mapping[str, Transform],
        found: Mapping[str, Detection],
        frame: Frame,
    ) -> PnpSolution | None:
        """PnP of the parts' keypoints, all in the base's frame."""
        parts, pnp = self._assembly.parts, self._pnp
        boxes = [found[name].box_xyxy for name in names]
        around = box_around(np.concatenate(boxes).reshape(-1, 2))
        # Keypoints are off by a share of their own part's box, however large the group is.
        share = float(np.mean([diagonal(box) for box in boxes])) / diagonal(around)
        return solve_pnp(
            np.concatenate([apply(T_base_parts[n], parts[n].keypoints) for n in names]),
            np.concatenate([found[name].keypoints_px for name in names]),
            frame.camera.K,
            config=replace(
                pnp,
                reprojection_share=pnp.reprojection_share * share,
                cauchy_share=pnp.cauchy_share * share,
            ),
            scores=np.concatenate([found[name].keypoint_scores for name in names]),
            box_xyxy=around,
            image_width=frame.camera.width,
        )
