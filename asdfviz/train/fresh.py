"""Pictures rendered while the network trains: they never repeat and are made where it trains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asdfviz.datatypes import Assembly
from asdfviz.pose.labels import Subject
from asdfviz.synth.assets import Assets, load_assets
from asdfviz.synth.frame_labels import picture_labels
from asdfviz.synth.frame_truth import truth_order
from asdfviz.synth.images import draw_picture
from asdfviz.synth.packs import PackConfig
from asdfviz.synth.scene import SceneConfig
from asdfviz.synth.sensor import photograph, random_rgb_sensor
from asdfviz.train.dataset import LabelledImage


@dataclass(frozen=True, slots=True)
class FreshConfig:
    """What is rendered while a network trains, and for how long it is drawn from."""

    kept: int
    """The latest so many pictures are drawn from, over all processes."""
    draws: int = 40
    """Inputs for each picture that is rendered; a training that wants more waits."""
    scenes: float = 0.5
    """Share of scenes among the pictures; the others are packs."""
    grouped: float = 0.5
    """Share of packs that show mostly joined groups, 0 to 1: from them states are learnt."""
    width: int = 640
    """Of the pictures, pixels."""
    height: int = 360
    """Of the pictures, pixels."""
    device: str = "cpu"
    """Where torch renders."""

    def kinds(self) -> tuple[tuple[float, SceneConfig | PackConfig], ...]:
        """What a picture may be, and how often it is."""
        scene = SceneConfig(width=self.width, height=self.height)
        pack = PackConfig(width=self.width, height=self.height)
        groups = PackConfig(
            width=self.width,
            height=self.height,
            sizes_px=(52.0, 180.0),
            coverage=0.55,
            groups=0.8,
            strays=0.12,
            occluders=0.06,
            hand=0.2,
        )
        rest = 1 - self.scenes
        return (
            (self.scenes, scene),
            (rest * (1 - self.grouped), pack),
            (rest * self.grouped, groups),
        )


class Painter:
    """Draws numbered pictures, each of one of the assemblies."""

    def __init__(self, assemblies: Sequence[Assembly], config: FreshConfig, *, seed: int) -> None:
        """Prepare the assemblies, in the order of the network's outputs."""
        self._seed = seed
        shares, self._kinds = zip(*config.kinds(), strict=True)
        self._shares = np.array(shares) / sum(shares)
        self._makers: list[tuple[Assets, Subject]] = []
        first = 0
        for assembly in assemblies:
            subject = Subject.of(assembly, first_label=first)
            self._makers.append((load_assets(assembly, device=config.device), subject))
            first += len(assembly.detector_classes)

    def draw(self, number: int) -> LabelledImage:
        """Render one picture; the same seed and number give the same one."""
        rng = np.random.default_rng([self._seed, number])
        # Not in turn: of numbers that go up in steps, as each process has them, some never come.
        assets, subject = self._makers[int(rng.integers(len(self._makers)))]
        kind = self._kinds[int(rng.choice(len(self._kinds), p=self._shares))]
        true_scene, picture = draw_picture(assets, rng=rng, config=kind)
        rgb = photograph(picture.radiance, sensor=random_rgb_sensor(rng), rng=rng)
        return LabelledImage(
            name=f"fresh/{number:06d}",
            assembly=subject.assembly.name,
            rgb=rgb,
            K=true_scene.scene.camera.K,
            objects=picture_labels(true_scene, picture, truth_order(true_scene), subject),
        )
