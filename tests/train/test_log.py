from __future__ import annotations

from pathlib import Path

from asdfviz.train.log import CsvLog

COLUMNS = ("step", "loss")


def filled(path: Path, steps: list[int]) -> CsvLog:
    log = CsvLog(path, COLUMNS, step=0)
    for step in steps:
        log.add({"step": float(step), "loss": 0.5})
    return log


def test_a_log_goes_on_after_the_rows_of_its_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    filled(path, [10, 20, 29])
    with path.open("a") as file:
        file.write("2")  # killed while it wrote 27
    log = CsvLog(path, COLUMNS, step=20)
    log.add({"step": 23.0})
    assert log.read()["step"] == [10.0, 20.0, 23.0]
    assert CsvLog(path, COLUMNS, step=23).read()["step"] == [10.0, 20.0, 23.0]
    assert CsvLog(path, COLUMNS, step=0).read()["step"] == []


def test_rounded_steps_are_of_the_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    filled(path, [1234566, 1234567])
    assert CsvLog(path, COLUMNS, step=1234567).read()["step"] == [1234570.0, 1234570.0]
