"""Training in short sittings on a machine that has torch, numpy and opencv and little else.

    python -m asdfviz.train.kit --assemblies models/vise models/screw_clamp \
        --total 30 --sitting 9 --device cuda --carried carried --out OUT

Data are rendered there while it trains, on CPU cores unless told otherwise, so nothing but the
assemblies travels, and weights to begin with. What comes back is small: the weights, the log, and the
state of the run cut into pieces. The same line with `--carried` naming these pieces goes on. Ctrl+C and
SIGTERM end a sitting early; what it learnt comes back as well.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from asdfviz.data.interrupts import stop_on_interrupt
from asdfviz.detector.device import require_device
from asdfviz.detector.weights import SCALES
from asdfviz.errors import AsdfvizError, Stopped
from asdfviz.train.checkpoint import export_weights, keep_average
from asdfviz.train.config import Stage, TrainConfig
from asdfviz.train.crop_config import CropTrainConfig
from asdfviz.train.crop_session import CropReport, CropSession
from asdfviz.train.loop import train
from asdfviz.train.pieces import cut_file, join_file
from asdfviz.train.session import TrainReport
from asdfviz.train.state_config import StateTrainConfig
from asdfviz.train.state_session import StateReport, StateSession

STATE = "state.pt"
"""What travels: how far the run is, with the averaged weights (detector) or all (others)."""
LINE_SECONDS = 60.0
SHARD = 256
"""Crops a file: many processes bring their first ones soon."""
HOLD = 0.3
"""Share of the detector's budget at the top learning rate."""


def parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Read the command line; argparse, because tyro may not be there."""
    line = argparse.ArgumentParser(prog="python -m asdfviz.train.kit", description=__doc__)
    line.formatter_class = argparse.RawDescriptionHelpFormatter
    line.add_argument("--assemblies", nargs="+", required=True, help="names or folders")
    line.add_argument("--network", choices=("detector", "crops", "states"), default="detector")
    line.add_argument("--out", type=Path, required=True, help="folder for what comes back")
    line.add_argument("--work", type=Path, default=Path("kit_run"), help="run folder on the spot")
    line.add_argument("--carried", type=Path, help="folder with the pieces of an earlier sitting")
    line.add_argument("--total", type=float, default=30.0, help="minutes of the whole run")
    line.add_argument("--sitting", type=float, default=9.0, help="minutes of this sitting")
    line.add_argument("--sitting-steps", type=int, help="steps of this sitting instead")
    line.add_argument("--start", type=Path, help="weights or checkpoint to begin with")
    line.add_argument("--scale", choices=SCALES, default="n", help="size of the network")
    line.add_argument("--keypoint-width", type=int, default=72)
    line.add_argument("--keypoint-gain", type=float, default=1.0)
    line.add_argument("--learning-rate", type=float, default=1.5e-3)
    line.add_argument("--batch", type=int, default=64, help="inputs a step")
    line.add_argument("--fresh", type=int, default=6000, help="pictures or crops in the pool")
    line.add_argument("--draws", type=int, default=40, help="inputs for which each is drawn from")
    line.add_argument("--crop-scenes", nargs="*", type=Path, default=(), help="cut crops out of")
    line.add_argument("--scenes", type=float, default=0.5, help="share of scenes among them")
    line.add_argument("--render-device", default="cpu", help="where the detector's are rendered")
    line.add_argument("--loaders", type=int, default=14, help="processes that render and load")
    line.add_argument("--image-size", type=int, default=640)
    line.add_argument("--device", default="cuda")
    line.add_argument("--seed", type=int, default=0)
    return line.parse_args(arguments)


def run_sitting(options: argparse.Namespace, asked: Callable[[], bool]) -> bool:
    """Train for one sitting, or until asked to end it, and leave what comes back in `out`.

    Returns:
        Whether the whole run is done.
    """
    for device in (options.device, options.render_device):
        require_device(device)
    work: Path = options.work
    work.mkdir(parents=True, exist_ok=True)
    if options.carried is not None and not (work / "last.pt").is_file():
        join_file(STATE, options.carried, work / "last.pt")
    options.out.mkdir(parents=True, exist_ok=True)
    sit = {"detector": _sit_with_detector, "crops": _sit_with_crops, "states": _sit_with_states}
    is_done = sit[options.network](options, work, asked)
    cut_file(work / STATE, options.out)
    shutil.copyfile(work / "log.csv", options.out / "log.csv")
    return is_done


def _sit_with_crops(options: argparse.Namespace, work: Path, asked: Callable[[], bool]) -> bool:
    config = CropTrainConfig(
        **_of_crops(options, work), learning_rate=options.learning_rate, validation_crops=12
    )
    return _sit(CropSession(config), "crops", options, work, asked)


def _sit_with_states(options: argparse.Namespace, work: Path, asked: Callable[[], bool]) -> bool:
    config = StateTrainConfig(**_of_crops(options, work), learning_rate=options.learning_rate)
    return _sit(StateSession(config), "states", options, work, asked)


def _of_crops(options: argparse.Namespace, work: Path) -> dict[str, Any]:
    """What training on crops is told alike."""
    return {
        "assemblies": tuple(options.assemblies),
        "output": work,
        "scenes": tuple(options.crop_scenes),
        "scene_share": 0.5,
        "start": options.start,
        "minutes": options.total,
        "generators": options.loaders,
        "shard": SHARD,
        "pool": max(1, options.fresh // SHARD),
        "first_shards": 4,
        "batch": options.batch,
        "device": options.device,
        "seed": options.seed,
    }


@runtime_checkable
class _Session(Protocol):
    """A run on crops."""

    @property
    def last(self) -> Path: ...

    def go(
        self, report: Callable[[CropReport | StateReport], None], stop: Callable[[], bool]
    ) -> bool: ...

    def validate(self) -> object: ...

    def checkpoint(self) -> None: ...


def _sit(
    session: _Session,
    name: str,
    options: argparse.Namespace,
    work: Path,
    asked: Callable[[], bool],
) -> bool:
    is_done = session.go(_minute_lines(), _sitting_over(options, asked))
    if not asked():  # who sends SIGTERM does not wait for long
        session.validate()
        session.checkpoint()
    shutil.copyfile(session.last, work / STATE)
    for file in (f"{name}.safetensors", f"{name}.json"):
        if (work / file).is_file():
            shutil.copyfile(work / file, options.out / file)
    return is_done


def _sit_with_detector(options: argparse.Namespace, work: Path, asked: Callable[[], bool]) -> bool:
    size: int = options.image_size
    config = TrainConfig(
        assemblies=tuple(options.assemblies),
        data=(),
        output=work,
        fresh=options.fresh,
        fresh_draws=options.draws,
        fresh_scenes=options.scenes,
        fresh_device=options.render_device,
        loaders=options.loaders,
        start=options.start,
        scale=options.scale,
        keypoint_width=options.keypoint_width,
        keypoint_gain=options.keypoint_gain,
        learning_rate=options.learning_rate,
        hold=HOLD,
        minutes=options.total,
        image_size=size,
        stages=(Stage(1.0, size, size * 3 // 5 // 64 * 64, options.batch, 0.5),),
        device=options.device,
        seed=options.seed,
    )
    result = train(config, progress=_minute_lines(), stop=_sitting_over(options, asked))
    keep_average(work / "last.pt", work / STATE)
    export_weights(work / STATE, options.out / "weights.safetensors")
    return result.finished


def _sitting_over(options: argparse.Namespace, asked: Callable[[], bool]) -> Callable[[], bool]:
    end = time.monotonic() + options.sitting * 60
    steps = itertools.count()
    if options.sitting_steps is not None:
        return lambda: next(steps) >= options.sitting_steps or asked()
    return lambda: time.monotonic() > end or asked()


def _minute_lines() -> Callable[[TrainReport | CropReport | StateReport], None]:
    told = 0.0

    def tell(report: TrainReport | CropReport | StateReport) -> None:
        nonlocal told
        if time.monotonic() - told >= LINE_SECONDS or report.share >= 1:
            told = time.monotonic()
            losses = " ".join(f"{name} {value:.2f}" for name, value in report.losses.items())
            rate = report.inputs_per_s if isinstance(report, TrainReport) else report.crops_per_s
            speed = f"{rate:.0f} inputs/s"
            sys.stdout.write(f"step {report.step} {100 * report.share:.1f} % {speed} {losses}\n")
            sys.stdout.flush()

    return tell


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one sitting; 0 when the whole run is done, 130 when there is more to do, 2 on bad input."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        with stop_on_interrupt() as asked:
            return 0 if run_sitting(options, asked) else 130
    except (KeyboardInterrupt, Stopped) as stopped:
        sys.stderr.write(f"stopped{f': {stopped}' if str(stopped) else ''}\n")
        return 130
    except AsdfvizError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2


if __name__ == "__main__":
    sys.exit(main())
