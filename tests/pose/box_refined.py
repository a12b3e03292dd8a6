"""Refines a pose of the rendered box by the depth in its box, and tells how far it is off."""

from __future__ import annotations

import numpy as np

from asdfviz.pose.translation import TranslationConfig, refine_translation


def refined(view, T_camera_part, depth, **options):
    return refine_translation(
        T_camera_part,
        view.surface,
        box_xyxy=view.box_xyxy,
        depth=depth,
        K=view.K,
        config=TranslationConfig(**options),
    )


def error_mm(T: np.ndarray | None, view) -> float:
    assert T is not None
    return float(1e3 * np.linalg.norm(T[:3, 3] - view.T_camera_part[:3, 3]))
