"""Saves and loads runs: run.json (what was run, on what) and predictions.jsonl (one frame a line).

Numbers are written so that they read back bit for bit. `format` rises when old programs could no
longer read what new ones write; keys that a reader does not know are ignored.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from asdfviz.data.atomic import write_text
from asdfviz.data.json_files import Json, parse_json, read_json
from asdfviz.data.prediction_lines import prediction_from, prediction_line
from asdfviz.datatypes import Assembly, FramePrediction, Run
from asdfviz.errors import RunError

FORMAT = 1
RUN, PREDICTIONS = "run.json", "predictions.jsonl"
RUNS = "runs"
"""Folder of a scene in which runs may lie beside the images, as the app puts them."""
RECORDED = ("rgb", "depth", "camera.json", "scene_camera.json", "scene_gt.json")
"""What only a recording has, in any of its formats."""


def check_run_folder(folder: Path, scene: Path) -> None:
    """See that a run's files, or what is made of it, will not lie among those of a recording.

    Raises:
        RunError: the folder is the scene's, holds it, lies in it elsewhere than in runs/, or is
            another recording.
    """
    out, recorded = folder.resolve(), scene.resolve()
    if out == recorded or out in recorded.parents:
        relation = "is" if out == recorded else "holds"
        raise RunError(
            f"{folder} {relation} the scene folder {scene}: name another folder for results, "
            f"such as {scene / RUNS / 'asdf'}"
        )
    if recorded in out.parents and out.relative_to(recorded).parts[:1] != (RUNS,):
        raise RunError(
            f"{folder} lies among the files of the scene {scene}: name a folder elsewhere for "
            f"results, or one in {scene / RUNS}"
        )
    if out == recorded / RUNS:
        raise RunError(
            f"{folder} is for several runs: name a folder in it, such as {folder / 'asdf'}"
        )
    refuse_recording(folder)


def refuse_recording(folder: Path) -> None:
    """See that results will not lie among the files of a recording.

    Raises:
        RunError: the folder is one.
    """
    recording = next((name for name in RECORDED if (folder / name).exists()), None)
    if recording is not None:
        raise RunError(
            f"{folder} is a recording itself (it has {recording}): name another folder for results"
        )


def save_run(run: Run, folder: Path) -> None:
    """Write a run into a folder, which is made if needed; a run that lay there is replaced.

    Raises:
        RunError: the config holds what JSON cannot, a pose is not finite, or the folder is the
            scene's own.
    """
    check_run_folder(folder, Path(run.sequence))
    about = {
        "format": FORMAT,
        "method": run.method,
        "config": _plain(run.config, "config"),
        "sequence": run.sequence,
        "assembly": run.assembly,
        "version": run.version,
        "initial": run.initial,
        "says_states": run.says_states,
        "hashes": dict(run.hashes),
        "frames": len(run.predictions),
    }
    lines = "".join(prediction_line(prediction) + "\n" for prediction in run.predictions)
    # run.json goes last and its forerunner first: a folder with a run.json is always whole.
    (folder / RUN).unlink(missing_ok=True)
    write_text(folder / PREDICTIONS, lines)
    write_text(folder / RUN, json.dumps(about, indent=2, ensure_ascii=False) + "\n")


def is_unfilled(folder: Path) -> bool:
    """Whether a run was begun in a folder and never saved, as when the program was killed meanwhile."""
    try:
        # What is half written has a name of its own, which begins with a dot (`atomic.write_bytes`).
        return all(file.name.startswith(".") for file in folder.iterdir())
    except OSError:
        return False  # there is none, or it cannot be read


def scene_of_run(folder: Path) -> str:
    """The sequence that a saved run is about, without reading its predictions.

    Raises:
        RunError: there is no run, or its description cannot be read.
    """
    return _described(folder).get("sequence").text()


def load_run(folder: Path, *, assembly: Assembly | None = None) -> Run:
    """Read a saved run; with an assembly, check that its parts and states are those of the run.

    Raises:
        RunError: a file is missing, cut off, corrupt, of a newer format, or does not fit.
    """
    about = _described(folder)
    predictions = _read_predictions(folder / PREDICTIONS, about.get("frames").integer())
    if assembly is not None:
        check_fits(predictions, assembly, folder)
    initial = about.get("initial").text()
    if initial not in ("none", "first_frame_truth"):
        raise about.get("initial").fail("none or first_frame_truth")
    says_states = about.find("says_states")  # runs of old programs lack it
    return Run(
        method=about.get("method").text(),
        config=cast(
            Mapping[str, object], {k: v.value for k, v in about.get("config").items().items()}
        ),
        sequence=about.get("sequence").text(),
        assembly=about.get("assembly").text(),
        version=about.get("version").text(),
        predictions=predictions,
        hashes={key: value.text() for key, value in about.get("hashes").items().items()},
        initial=initial,
        says_states=says_states is None or says_states.boolean(),
    )


def check_fits(predictions: Iterable[FramePrediction], assembly: Assembly, source: object) -> None:
    """See that a run's parts and states are those of an assembly.

    Raises:
        RunError: with the run's folder or file, `source`, and the frame.
    """
    for prediction in predictions:
        where = f"{source}: frame {prediction.frame_index}"
        unknown = [name for name in prediction.poses if name not in assembly.parts]
        if unknown:
            raise RunError(
                f"{where} has a pose of '{unknown[0]}', which is no part of {assembly.name}; "
                f"parts: {', '.join(assembly.parts)}"
            )
        state = prediction.state
        if state is not None and len(state.probabilities) != len(assembly.states):
            raise RunError(
                f"{where} has {len(state.probabilities)} state probabilities, but "
                f"{assembly.name} has {len(assembly.states)} states"
            )


def _described(folder: Path) -> Json:
    if not (folder / RUN).is_file():
        raise RunError(
            f"no run in {folder}: it has no {RUN}; give a folder that `asdfviz run --out` wrote"
        )
    about = read_json(folder / RUN, error=RunError)
    version = about.get("format").integer()
    if not 1 <= version <= FORMAT:
        raise RunError(
            f"{about.where} has format {version}, this program reads 1 to {FORMAT}; "
            "update asdfviz or run the method again"
        )
    return about


def _read_predictions(file: Path, expected: int) -> tuple[FramePrediction, ...]:
    try:
        text = file.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise RunError(f"{file} does not exist, though {RUN} lies beside it") from error
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"{file} cannot be read: {error}") from error
    # Only "\n" ends a line here: str.splitlines would also cut at characters inside names.
    lines = [line for line in text.split("\n") if line]
    found = tuple(
        prediction_from(parse_json(line, where=f"{file} line {number}", error=RunError))
        for number, line in enumerate(lines, start=1)
    )
    if len(found) != expected:
        raise RunError(
            f"{file} holds {len(found)} frames, but {RUN} says {expected}: it was cut off; "
            "run the method again"
        )
    indices = [prediction.frame_index for prediction in found]
    if len(set(indices)) != len(indices):
        raise RunError(f"{file} holds a frame twice")
    return found


def _plain(value: object, where: str) -> object:
    """Turn a config value into what JSON can hold."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.generic):
        return _plain(cast(object, value.item()), where)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _plain(dataclasses.asdict(value), where)
    if isinstance(value, Mapping):
        members = cast(Mapping[Any, object], value)
        return {str(k): _plain(v, f"{where}.{k}") for k, v in members.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v, where) for v in cast(Iterable[object], value)]
    raise RunError(f"{where} is a {type(value).__name__}, which a run file cannot hold")
