"""What weights say of how they came to be, without the places of the machine that made them."""

from __future__ import annotations

import dataclasses
import json
import platform
import sys
from pathlib import Path
from typing import Any, cast

import torch


def made_by() -> str:
    """The command line of this process, the program and absolute paths by their names alone."""
    return " ".join(cast(list[str], without_places([Path(sys.argv[0]).name, *sys.argv[1:]])))


def record_of(
    config: object, weights: Path, *, steps: int, batch: int, seconds: float
) -> dict[str, object]:
    """How weights that were trained on crops came to be, as far as all such weights tell alike.

    Args:
        config: of the run, a dataclass.
        weights: file that holds them.
        steps: that were taken.
        batch: crops a step.
        seconds: that this took.
    """
    return {
        "command": made_by(),
        "machine": f"{platform.machine()}, {platform.processor() or platform.system()}",
        "torch": torch.__version__,
        "steps": steps,
        "crops": steps * batch,
        "minutes": round(seconds / 60, 1),
        "bytes": weights.stat().st_size,
        "config": without_places(dataclasses.asdict(cast(Any, config))),
    }


def without_places(value: object) -> Any:
    """A copy as JSON has it, in which absolute paths are their last part: weights get shared."""
    plain: object = json.loads(json.dumps(value, default=str))
    return _named(plain)


def _named(value: object) -> object:
    if isinstance(value, dict):
        return {key: _named(item) for key, item in cast(dict[str, object], value).items()}
    if isinstance(value, list):
        return [_named(item) for item in cast(list[object], value)]
    if isinstance(value, str) and Path(value).is_absolute():
        return Path(value).name
    return value
