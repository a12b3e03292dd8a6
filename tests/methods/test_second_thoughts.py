"""A runner-up takes the place of a pose for which contours do not speak."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from asdfviz.datatypes import Frame
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import transform_from
from asdfviz.methods.contour_fits import ContourConfig, ContourFit, ContourFits
from asdfviz.methods.kept_poses import Decision, HypothesesConfig, Proposal
from asdfviz.methods.looked_at import LookedAt
from asdfviz.methods.part_hypotheses import PartHypotheses
from asdfviz.methods.part_poses import part_shapes
from asdfviz.methods.registration import RegistrationConfig
from asdfviz.methods.second_thoughts import settled_by_contours
from asdfviz.methods.tracking import load_bodies
from asdfviz.track.confidence import Evidence
from asdfviz.track.starts import Trial

LOOKS: dict[str, LookedAt] = {}
pytestmark = pytest.mark.usefixtures("small_models")


class Contours(ContourFits):
    """Contours that are sure so much of the pose decided, and so much of any other."""

    def __init__(self, toy: Any, decided: float, other: float) -> None:
        """Of the block alone."""
        block = {"block": toy.assembly.parts["block"]}
        bodies = {"block": load_bodies(toy.assembly)["block"]}
        super().__init__(block, bodies, toy.frame(0, {}).camera, config=ContourConfig())
        self._decided = decided

        def trials(frame: Frame, name: str, starts: list[Transform], **_: object) -> list[Trial]:
            return [Trial(T, Evidence(0.5, 0.5, 1.0), other) for T in starts]

        self._tracker.trials = trials  # type: ignore[method-assign]

    def step(
        self, frame: Frame, poses: Any, *, held: Any = (), looked_at: Any = None
    ) -> dict[str, ContourFit]:
        """What is asked of the real one."""
        self.looked_at = looked_at
        self._tracker.add(frame, poses)
        return {name: ContourFit(T, self._decided, moved=False) for name, T in poses.items()}


@pytest.mark.parametrize(
    ("decided", "other", "gives_way"),
    [(0.0, 0.9, True), (0.0, 0.2, False), (0.6, 0.9, False)],
    ids=["gives way", "neither is sure", "is sure enough"],
)
def test_a_pose_without_contours_gives_way(
    toy: Any, decided: float, other: float, gives_way: bool
) -> None:
    true = toy.poses(joined=False)
    right, frame = true["block"], toy.frame(1, true)
    beside = transform_from(right[:3, :3], right[:3, 3] + np.array([0.03, 0.0, 0.0]))
    kept = PartHypotheses(
        toy.assembly.parts["block"],
        part_shapes(toy.assembly, surface_points=900)["block"],
        config=HypothesesConfig(),
        registration=RegistrationConfig(),
    )
    both = [Proposal(right, 0.9, is_fitted=True), Proposal(beside, 1.0, is_fitted=True)]
    first = kept.step(both, frame, box_xyxy=toy.detection("block", right).box_xyxy)
    assert first is not None
    assert first.rival is not None
    believed: dict[str, Decision] = {"block": first}
    contours = Contours(toy, decided, other)
    chosen, fits = settled_by_contours(
        contours, {"block": kept}, believed, frame, held=(), looked_at=LOOKS
    )
    assert contours.looked_at is LOOKS  # turns are told with what crops say
    expected = first.rival if gives_way else first.best
    assert chosen["block"].best is expected
    np.testing.assert_allclose(fits["block"].T_camera_part, expected.T_camera_part)
    assert fits["block"].sure == pytest.approx(other if gives_way else decided)
    nothing = settled_by_contours(None, {"block": kept}, believed, frame, held=(), looked_at=LOOKS)
    assert nothing[1] == {}
