from __future__ import annotations

import importlib
import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from asdfviz.data import interrupts
from asdfviz.data.interrupts import interrupts_after_imports, stop_on_interrupt


@pytest.mark.parametrize("first", [signal.SIGINT, signal.SIGTERM])
def test_a_long_job_is_asked_to_stop_and_ctrl_c_ends_it_at_once(first: signal.Signals) -> None:
    before = [signal.getsignal(kind) for kind in (signal.SIGINT, signal.SIGTERM)]
    with stop_on_interrupt() as stop:
        assert not stop()
        signal.raise_signal(first)
        assert stop()
        signal.raise_signal(signal.SIGTERM)  # a batch queue sends it again: what is saved is saved
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert [signal.getsignal(kind) for kind in (signal.SIGINT, signal.SIGTERM)] == before


SWALLOWING = """
import signal, time
try:
    signal.raise_signal(signal.SIGINT)
    time.sleep(0.1)
    missed = False
except BaseException:
    missed = True
"""
"""What a library may do about an optional import."""


def import_and_wait(name: str) -> None:
    with interrupts_after_imports():
        assert not importlib.import_module(name).missed
        for _ in range(200):
            time.sleep(0.01)


@pytest.fixture
def plain_ctrl_c() -> Iterator[None]:
    """Ctrl+C interrupts, whatever tests of before have made of it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("plain_ctrl_c")
def test_ctrl_c_within_an_import_comes_after_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "swallows_interrupts.py").write_text(SWALLOWING)
    with pytest.raises(KeyboardInterrupt):
        import_and_wait("swallows_interrupts")
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with pytest.raises(KeyboardInterrupt), interrupts_after_imports():
        signal.raise_signal(signal.SIGINT)
    (tmp_path / "ends_at_once.py").write_text("import signal; signal.raise_signal(signal.SIGINT)")
    with pytest.raises(KeyboardInterrupt), interrupts_after_imports():
        importlib.import_module("ends_at_once")
    monkeypatch.setattr(interrupts, "PATIENCE", -1.0)  # an import that never ends
    (tmp_path / "takes_long.py").write_text("import signal; signal.raise_signal(signal.SIGINT)")
    with pytest.raises(KeyboardInterrupt), interrupts_after_imports():
        importlib.import_module("takes_long")


def test_ctrl_c_of_others_is_left_alone() -> None:
    def mine(*_: object) -> None:
        pass

    before = signal.signal(signal.SIGINT, mine)
    try:
        with interrupts_after_imports():
            assert signal.getsignal(signal.SIGINT) is mine
    finally:
        signal.signal(signal.SIGINT, before)
    found: list[object] = []

    def elsewhere() -> None:
        with interrupts_after_imports():
            found.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert found == [before]
