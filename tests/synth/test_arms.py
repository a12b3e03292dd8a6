"""How the arms of hands that hold something or pass by lie in the picture."""

from __future__ import annotations

import numpy as np

from asdfviz.synth.hands import ARM_RISE, GRASPS, HOLDING
from asdfviz.synth.layout import dress


def test_forearms_rise_as_those_of_somebody_at_a_table() -> None:
    """Whatever the wrist's bend is: a pose whose fingers point down by the rise less the bend."""
    rng = np.random.default_rng(0)
    away = np.array([0.6, 0.8, 0.0])
    for grasp in range(HOLDING):
        outfit = dress(rng, grasp=grasp)
        wrist = GRASPS[grasp].wrist
        for rise in ARM_RISE:
            T = outfit.pose(np.zeros(3), away, pitch=rise - wrist, roll=0.0)
            R = T[:3, :3] / outfit.size
            arm = R @ np.array([0.0, -np.cos(wrist), np.sin(wrist)])
            assert abs(np.arcsin(arm[2]) - rise) < 0.12
            assert arm @ away > 0.75
