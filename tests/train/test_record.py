from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

import pytest

from asdfviz.train.record import made_by, without_places


@dataclass
class Config:
    data: tuple[Path, ...]
    name: str


def test_no_place_of_the_machine_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    config = asdict(Config((Path("/home/me/secret/data/train"), Path("data/val")), "a/b"))
    assert without_places(config) == {"data": ["train", "data/val"], "name": "a/b"}
    line = ["/opt/env/bin/asdfviz", "train", "--data", "/mnt/disk/packs", "--seed", "3"]
    monkeypatch.setattr("sys.argv", line)
    assert made_by() == "asdfviz train --data packs --seed 3"
