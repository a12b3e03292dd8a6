"""`asdfviz bench`: speed and accuracy against references, as ratios in one run."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro

from asdfviz.cli.judged_runs import known_assembly, known_truth
from asdfviz.cli.progress import progress_bar
from asdfviz.errors import InputError


@dataclass(frozen=True)
class BenchTrack:
    """Run the tracker with every preset: on a folder with a reference's results, or on many parts.

    Example: asdfviz bench track tracker_jaw640
    Example: asdfviz bench track --parts 10
    """

    folder: Annotated[Path | None, tyro.conf.Positional] = None
    """Folder with color, depth, gt.txt, init.txt, mesh.obj, meta.json and m3t_* results."""
    parts: int | None = None
    """Time so many parts at once instead, at 1280x720, in a scene that is made on the spot."""
    assembly: str = "screw_clamp"
    """Whose parts those are, repeated as often as it takes."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> None:
        """Print accuracy and time, mode by mode, ours beside the reference's."""
        if (self.folder is None) == (self.parts is None):
            raise InputError("bench track: give either a folder or --parts, such as --parts 10")
        print(self._on_parts() if self.folder is None else self._on_folder(self.folder))

    def _on_folder(self, folder: Path) -> str:
        from asdfviz.bench.track import bench_table, json_report, measure

        results = measure(folder)
        return json.dumps(json_report(results), indent=2) if self.json else bench_table(results)

    def _on_parts(self) -> str:
        from asdfviz.bench.track_parts import measure_parts, parts_table
        from asdfviz.data.assembly import load_assembly

        if self.parts is None or self.parts < 1:
            raise InputError(f"bench track: --parts is {self.parts}, give at least 1")
        with progress_bar("views") as report:
            results = measure_parts(
                load_assembly(self.assembly),
                parts=self.parts,
                progress=lambda done, total: report(done, total, ""),
            )
        if self.json:
            return json.dumps({name: asdict(row) for name, row in results.items()}, indent=2)
        return parts_table(results)


@dataclass(frozen=True)
class BenchLoss:
    """How well scores tell lost poses (ADD above 0.1 d) from right ones (below 0.05 d).

    Runs must hold the poses of lost parts too, as those of `asdfviz tables gbot` do.

    Example: asdfviz run --method icg my_sequence --out runs/icg --report-lost
    Example: asdfviz bench loss runs/icg
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of runs; their poses are judged together."""
    visible: float = 0.1
    """Visible share of a part from which its pose counts, 0 to 1."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> None:
        """Print the area under the ROC curve in percent, and how many poses of each kind there are."""
        from asdfviz.evaluate.calibration import ranking_area
        from asdfviz.evaluate.protocols import TWINS

        if not self.runs:
            raise InputError("name at least one run folder, as in: asdfviz bench loss runs/icg")
        by_name, by_twin = self._told_apart()
        figures: dict[str, float | int | None] = {}
        for suffix, told in (("", by_name), (TWINS, by_twin)):
            right = sum(is_right for _, is_right in told)
            figures[f"loss_auc{suffix}"] = ranking_area(told)
            figures |= {f"right{suffix}": right, f"lost{suffix}": len(told) - right}
        if figures["loss_auc"] is None:
            raise InputError(
                f"bench loss: of the poses with a score that count, {figures['right']} are right and "
                f"{figures['lost']} are lost, and there must be both: give runs that hold lost "
                "poses too, as made with --report-lost"
            )
        if self.json:
            print(json.dumps(figures, indent=2))
            return
        for suffix, title in (("", ""), (TWINS, ", on either twin counts as right")):
            if suffix and by_twin == by_name:
                break
            area = figures[f"loss_auc{suffix}"]
            shown = "-" if area is None else f"{area:.1f} %"
            right, lost = figures[f"right{suffix}"], figures[f"lost{suffix}"]
            print(f"AUC {shown}: {right} right poses, {lost} lost ones{title}")

    def _told_apart(self) -> tuple[list[tuple[float, bool]], list[tuple[float, bool]]]:
        """Scores of all runs' poses and whether they are right: by name, and on either twin."""
        from asdfviz.bench.loss import told_apart
        from asdfviz.evaluate.inputs import open_result
        from asdfviz.evaluate.judgement import judge

        by_name: list[tuple[float, bool]] = []
        by_twin: list[tuple[float, bool]] = []
        for path in self.runs:
            result = open_result(path)
            judged = judge(
                result.run,
                assembly=result.assembly,
                truth=result.truth,
                views=result.view,
            )
            diameters = {name: part.diameter for name, part in result.assembly.parts.items()}
            compared = judged.comparison
            for told, records in ((by_name, compared.records), (by_twin, compared.exchanged)):
                told += told_apart(
                    (r.score, r.error.add_s / diameters[r.part])
                    for r in records
                    if r.error is not None and r.score is not None and r.visible >= self.visible
                )
        return by_name, by_twin


@dataclass(frozen=True)
class BenchSynth:
    """Time the generator of training images.

    Example: asdfviz bench synth --assembly corner_clamp --workers 2
    """

    assembly: str = "corner_clamp"
    """assembly.yaml, its folder, or a bundled name."""
    images: int = 10
    """Timed images of each kind and size, in every process."""
    workers: int = 1
    """Processes that share the cores, as in `synth images`; 1 is one process with all of them."""
    device: str = "cpu"
    """Where torch renders: cpu or cuda."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> None:
        """Print images a second by kind and size, and the machine's load."""
        from asdfviz.bench.synth import measure_synth, speed_table
        from asdfviz.data.assembly import load_assembly
        from asdfviz.detector.device import require_device

        require_device(self.device)
        with progress_bar("bench synth") as report:
            speeds = measure_synth(
                load_assembly(self.assembly),
                images=self.images,
                workers=self.workers,
                device=self.device,
                progress=lambda done, total: report(done, total, ""),
            )
        print(json.dumps([vars(s) for s in speeds], indent=2) if self.json else speed_table(speeds))


@dataclass(frozen=True)
class BenchFirstPoses:
    """Time first poses from crops: the crop network alone, and all of it with settling.

    Example: asdfviz bench first-poses sample --parts 9
    """

    scene: Annotated[str, tyro.conf.Positional] = "sample"
    """Scene folder with true poses, or `sample`."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name. Default: what the scene names."""
    parts: int = 9
    """Looked at in every frame: those that are seen, as often as it takes."""
    frames: int = 20
    """Timed frames, evenly from the whole scene."""
    device: str = "cpu"
    """Where torch runs: cpu or cuda."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> None:
        """Print milliseconds a frame, and the machine's load."""
        from asdfviz.bench.first_poses import first_pose_table, measure_first_poses, some_frames
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.sequences import open_sequence
        from asdfviz.methods.first_pose import CropPoseConfig

        known = None if self.assembly is None else load_assembly(self.assembly)
        sequence = open_sequence(self.scene, assembly=known)
        assembly = known_assembly(sequence, "--assembly")
        truth = known_truth(sequence, assembly)
        with progress_bar("first poses") as report:
            measured = measure_first_poses(
                assembly,
                some_frames(sequence, truth, self.frames),
                parts=self.parts,
                config=CropPoseConfig(device=self.device),
                progress=lambda done, total: report(done, total, ""),
            )
        print(json.dumps(asdict(measured), indent=2) if self.json else first_pose_table(measured))


@dataclass(frozen=True)
class BenchKeypoints:
    """What keypoint scores are worth: whether surer ones are nearer, and PnP with them and without.

    Example: asdfviz run --method yolov8pose my_sequence --out runs/first
    Example: asdfviz bench keypoints runs/first
    """

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of runs of sequences with truth, whose detections have keypoints; judged together."""
    json: bool = False
    """Print JSON."""

    def __call__(self) -> None:
        """Print distances by score, their rank correlation, and how far off rotations are."""
        from asdfviz.bench.keypoints import (
            KnownBox,
            keypoint_table,
            known_boxes,
            measure_keypoints,
        )
        from asdfviz.evaluate.inputs import open_result

        boxes: list[KnownBox] = []
        for path in self.runs:
            result = open_result(path)
            predictions, camera_of = result.run.predictions, result.sequence.camera_of
            boxes += known_boxes(result.assembly, predictions, result.truth, camera_of)
        figures = measure_keypoints(boxes)
        if figures is None:
            raise InputError(
                "bench keypoints: no box with keypoints lies on a part: name runs of methods with a "
                "detector, as in: asdfviz bench keypoints runs/asdf"
            )
        print(json.dumps(asdict(figures), indent=2) if self.json else keypoint_table(figures))


@dataclass(frozen=True)
class Bench:
    """Measure speed; figures are ratios within one run, the machine's load is printed."""

    what: (
        Annotated[BenchTrack, tyro.conf.subcommand("track")]
        | Annotated[BenchLoss, tyro.conf.subcommand("loss")]
        | Annotated[BenchSynth, tyro.conf.subcommand("synth")]
        | Annotated[BenchFirstPoses, tyro.conf.subcommand("first-poses")]
        | Annotated[BenchKeypoints, tyro.conf.subcommand("keypoints")]
    )

    def __call__(self) -> None:
        """Run the chosen benchmark."""
        self.what()
