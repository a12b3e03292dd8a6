from __future__ import annotations

import signal

import pytest

from asdfviz.data.interrupts import stop_on_interrupt


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
