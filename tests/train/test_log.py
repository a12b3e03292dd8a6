from __future__ import annotations

from pathlib import Path

import numpy as np

from asdfviz.train.log import CsvLog, write_curve

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


def test_a_run_that_goes_on_may_measure_other_things(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    filled(path, [10])
    more = CsvLog(path, ("step", "recall", "loss"), step=10)
    more.add({"step": 20.0, "recall": 0.25, "loss": 0.5})
    write_curve(tmp_path / "curve.png", more, x="step", curves=("loss", "recall"))
    CsvLog(path, COLUMNS, step=20).add({"step": 30.0, "loss": 0.125})
    rows = ["step,loss,recall", "10,0.5,", "20,0.5,0.25", "30,0.125,"]
    assert path.read_text().splitlines() == rows
    found = CsvLog(path, COLUMNS, step=30).read()
    np.testing.assert_array_equal(found["recall"], [np.nan, 0.25, np.nan])
