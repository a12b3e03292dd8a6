"""What `ablate keypoints` compares: what is made of keypoints, each piece off."""

from __future__ import annotations

from dataclasses import replace

from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.variants import Variant
from asdfviz.pose.pnp import ROBUST_PNP, PnpConfig


def keypoint_variants() -> list[Variant]:
    """First poses from keypoints: one solver and the other, the group's, and the twins of flat parts."""
    asdf = AsdfConfig(first_pose="keypoints")
    plus = AsdfPlusConfig(first_pose="keypoints")
    single = replace(ROBUST_PNP, mirrored=False)
    alone = replace(plus, joined=replace(plus.joined, pooled=False))
    rows = {
        "asdf": asdf,
        "asdf, parts' keypoints alone": replace(asdf, group=replace(asdf.group, pooled=False)),
        "asdf, RANSAC as published": replace(asdf, pnp=PnpConfig()),
        "asdf_plus": plus,
        "asdf_plus, parts' keypoints alone": alone,
        "asdf_plus, flat parts one way": replace(plus, pnp=single),
        "asdf_plus, neither": replace(alone, pnp=single),
        "asdf_plus, RANSAC as published": replace(plus, pnp=PnpConfig()),
    }
    return [Variant(title, title.split(",")[0], config) for title, config in rows.items()]
