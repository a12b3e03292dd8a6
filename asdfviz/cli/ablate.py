"""`asdfviz ablate`: what each piece of the method is worth, one command for each of the paper's tables."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from asdfviz.cli.judged_runs import (
    give_table,
    judged,
    known_assembly,
    known_truth,
    layout_for,
    made_run,
)
from asdfviz.cli.progress import progress_bar, stop_on_interrupt
from asdfviz.errors import InputError, Stopped, WeightsError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from asdfviz.data.folder_sequence import FolderSequence
    from asdfviz.datatypes import Assembly
    from asdfviz.evaluate.paper_ablations import Backbone, JudgedVariant
    from asdfviz.evaluate.paper_layout import Layout
    from asdfviz.methods.variants import Variant

NOTES = {
    "refinement": "paper: Table 2, on an RTX 3090 and its own test sets. ours: strict, means over scenes.",
    "weighting": "The paper gives no W(d), only that it favours small shifts. one step: its refinement "
    "to the letter; else a coarse step and four with a narrowing scale.",
    "backbone": "paper: Table 3, on an RTX 3090. Times of untrained sizes are measured with random "
    "weights; accuracy is printed of trained ones alone.",
    "fusion": "The paper gives no weights. The best of the grid was found on these very scenes.",
    "keypoints": "Not in the paper but for RANSAC: the group's keypoints solved together, and the other pose "
    "that those of a flat part may mean.",
    "group": "The paper claims that the state helps the pose and gives no figures.",
    "states": "Not in the paper: states told apart by what the camera sees of each one's group.",
    "beyond": "Not in the paper: looking again, the network's opinion over time, tracks begun anew.",
}
STOPPED = "no table is made of half a comparison"


@dataclass(frozen=True)
class Ablate:
    """Compare variants of the method on scenes with truth.

    refinement: Table 2, what depth does to first poses. weighting: the weight function W(d) of its
    shift, which the paper leaves open. backbone: Table 3, sizes of the network.
    fusion: the weights of Pose2State. keypoints: what is made of them, each piece off. group:
    state helps pose, on and off. states: the test of every state's group against the picture, on
    and off. beyond: what asdf_plus and asdf_track weigh besides, each piece off.

    Example: asdfviz ablate refinement --data sample --out table2.md
    """

    what: Annotated[
        Literal[
            "refinement",
            "weighting",
            "backbone",
            "fusion",
            "keypoints",
            "group",
            "states",
            "beyond",
        ],
        tyro.conf.Positional,
    ]
    """Which comparison."""
    data: tuple[str, ...] = ("sample",)
    """Scene folders with truth, or `sample`."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name. Default: what each scene names."""
    out: Path | None = None
    """File for the table, .md, .csv or .tex. Default: Markdown on stdout."""
    weights: tuple[Path, ...] = ()
    """backbone: further trained weights of the detector. The assembly's own are judged anyway."""
    pictures: int = 5
    """backbone: frames that are timed for each size."""

    def __call__(self) -> None:
        """Run the variants, judge them, and print or write the table."""
        layout = layout_for(self.out)
        if not self.data:
            raise InputError("name scenes, as in: asdfviz ablate group --data sample")
        if self.pictures < 1:
            raise InputError(f"--pictures is {self.pictures}, use 1 or more")
        scenes = [self._open(name) for name in self.data]
        for scene in scenes:  # a scene without truth is told before hours of work
            known_truth(scene, known_assembly(scene, "--assembly"))
        make = {
            "refinement": self._refinement,
            "weighting": self._weighting,
            "backbone": self._backbone,
            "fusion": self._fusion,
            "keypoints": self._plain,
            "group": self._plain,
            "states": self._plain,
            "beyond": self._beyond,
        }
        give_table(make[self.what](scenes, layout), NOTES[self.what], self.out)

    def _open(self, name: str) -> FolderSequence:
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.sequences import open_sequence

        known = None if self.assembly is None else load_assembly(self.assembly)
        return open_sequence(name, assembly=known)

    def _refinement(self, scenes: list[FolderSequence], layout: Layout) -> str:
        from asdfviz.evaluate.paper_ablations import refinement_table
        from asdfviz.methods.variants import refinement_variants

        return refinement_table(_all_judged(scenes, refinement_variants), layout=layout)

    def _weighting(self, scenes: list[FolderSequence], layout: Layout) -> str:
        from asdfviz.evaluate.paper_ablations import plain_table
        from asdfviz.methods.variants import weighting_variants

        judged = _all_judged(scenes, weighting_variants)
        return plain_table(judged, states=False, layout=layout)

    def _plain(self, scenes: list[FolderSequence], layout: Layout) -> str:
        from asdfviz.evaluate.paper_ablations import plain_table
        from asdfviz.methods.keypoint_variants import keypoint_variants
        from asdfviz.methods.variants import group_variants, state_variants

        variants_of: dict[str, Callable[[Assembly], Sequence[Variant]]] = {
            "keypoints": lambda _: keypoint_variants(),
            "group": group_variants,
            "states": state_variants,
        }
        return plain_table(_all_judged(scenes, variants_of[self.what]), layout=layout)

    def _beyond(self, scenes: list[FolderSequence], layout: Layout) -> str:
        from asdfviz.evaluate.paper_ablations import plain_table
        from asdfviz.methods.variants import beyond_variants

        found = _all_judged(scenes, beyond_variants)
        if not found:
            raise WeightsError(
                "ablate beyond needs crop weights: put crops.safetensors beside assembly.yaml, or "
                "train them with `asdfviz train-crops`"
            )
        return plain_table(found, layout=layout)

    def _fusion(self, scenes: list[FolderSequence], layout: Layout) -> str:
        from asdfviz.evaluate.fusion_study import StudiedRun, fusion_study
        from asdfviz.evaluate.paper_ablations import plain_table
        from asdfviz.methods.registry import find_method

        spec = find_method("asdf")
        runs: list[StudiedRun] = []
        for scene in scenes:
            assembly = known_assembly(scene, "--assembly")
            run = made_run(
                spec, scene, spec.config(), title=f"asdf {scene.name}", if_stopped=STOPPED
            )
            by_places = run.config["state_looks"] == "places"
            fusion = spec.config().fusion.chosen(places=by_places)
            truth = known_truth(scene, assembly)
            runs.append(StudiedRun(assembly, run.predictions, truth, fusion))
        with progress_bar("weights") as report:
            found = fusion_study(runs, progress=lambda done, total: report(done, total, ""))
        return plain_table(found, poses=False, layout=layout)

    def _backbone(self, scenes: list[FolderSequence], layout: Layout) -> str:
        from asdfviz.bench.backbones import network_time
        from asdfviz.detector.detector import DetectorConfig
        from asdfviz.detector.weights import SCALES, load_network
        from asdfviz.evaluate.paper_ablations import Backbone, backbone_table
        from asdfviz.methods.network import NetworkConfig, weights_path

        own = {
            weights_path(NetworkConfig(), known_assembly(scene, "--assembly")) for scene in scenes
        }
        files = [*sorted(path for path in own if path.is_file()), *self.weights]
        judged_of: dict[str, list[JudgedVariant]] = {}
        for path in files:
            variants = [_judged_backbone(path, scene) for scene in scenes]
            judged_of.setdefault(load_network(path).scale, []).extend(variants)
        first = scenes[0]
        classes = known_assembly(first, "--assembly").detector_classes
        pictures = [first[i].rgb for i in range(min(self.pictures, len(first)))]
        rows: list[Backbone] = []
        with progress_bar("time by size") as report, stop_on_interrupt() as stop:
            for place, scale in enumerate(SCALES):
                if stop():
                    raise Stopped(STOPPED)
                timed = network_time(scale, pictures, classes=classes, config=DetectorConfig())
                rows.append(
                    Backbone(
                        scale,
                        timed.million_weights,
                        timed.ms,
                        tuple(judged_of.get(scale, ())),
                    )
                )
                report(place + 1, len(SCALES), scale)
        return backbone_table(rows, layout=layout)


def _all_judged(
    scenes: list[FolderSequence], variants_of: Callable[[Assembly], Sequence[Variant]]
) -> list[JudgedVariant]:
    """Every variant of every scene's assembly, judged on that scene."""
    return [
        _judged_variant(variant, scene)
        for scene in scenes
        for variant in variants_of(known_assembly(scene, "--assembly"))
    ]


def _judged_variant(variant: Variant, scene: FolderSequence) -> JudgedVariant:
    from asdfviz.evaluate.evaluate import protocol_report
    from asdfviz.evaluate.paper_ablations import JudgedVariant
    from asdfviz.methods.registry import find_method

    title = f"{variant.title} {scene.name}"
    spec = find_method(variant.method)
    run = made_run(spec, scene, variant.config, title=title, if_stopped=STOPPED)
    found = judged(run, scene, option="--assembly")
    return JudgedVariant(variant.title, variant.paper, protocol_report(found, protocol="strict"))


def _judged_backbone(weights: Path, scene: FolderSequence) -> JudgedVariant:
    """ASDF with these weights on a scene; first poses from keypoints, which is what they give."""
    from asdfviz.methods.registry import find_method
    from asdfviz.methods.variants import Variant

    config: Any = find_method("asdf").config()
    network = dataclasses.replace(config.detector, weights=weights)
    config = dataclasses.replace(config, detector=network, first_pose="keypoints")
    return _judged_variant(Variant(weights.parent.name + "/" + weights.name, "asdf", config), scene)
