from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from asdfviz.data.prefetch import Prefetcher
from asdfviz.datatypes import Assembly, Camera, Frame, FrameTruth
from asdfviz.errors import SequenceError

CAMERA = Camera(np.array([[50.0, 0, 4], [0, 50.0, 3], [0, 0, 1]]), 8, 6)


class SlowSequence:
    """Twenty frames; remembers who read what, and can be made to wait or to fail."""

    name = "slow"
    path = "/slow"
    assembly: Assembly | None = None
    camera = CAMERA

    def __init__(self, *, broken: frozenset[int] = frozenset()) -> None:
        self.frame_indices = tuple(range(100, 120))
        self.reads: list[tuple[int, str]] = []
        self.gate = threading.Event()
        self.gate.set()
        self._broken = broken

    def __len__(self) -> int:
        return 20

    def __getitem__(self, place: int) -> Frame:
        self.reads.append((place, threading.current_thread().name))
        assert self.gate.wait(5)
        if place in self._broken:
            raise SequenceError(f"frame {place} is broken")
        rgb = np.full((6, 8, 3), place, dtype=np.uint8)
        return Frame(100 + place, place / 30, rgb, None, CAMERA)

    def truth(self, place: int) -> FrameTruth | None:
        return FrameTruth(100 + place, {}, None)


def eventually(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 5
    while not condition():
        assert time.monotonic() < end, "it did not happen within 5 s"
        time.sleep(0.002)


def test_it_is_the_sequence_behind() -> None:
    fetcher = Prefetcher(SlowSequence())
    assert (fetcher.name, fetcher.path, len(fetcher)) == ("slow", "/slow", 20)
    assert fetcher.frame_indices[0] == 100
    assert fetcher.camera is CAMERA
    truth = fetcher.truth(3)
    assert truth is not None
    assert truth.frame_index == 103
    assert fetcher[-1].index == 119
    with pytest.raises(IndexError):
        fetcher[20]
    fetcher.close()


def test_wishes_are_decoded_on_another_thread_and_kept() -> None:
    source = SlowSequence()
    fetcher = Prefetcher(source, capacity=8)
    assert fetcher.peek(4) is None
    fetcher.wish([4, 5, 6, 99, -1])
    eventually(lambda: fetcher.peek(6) is not None)
    assert [place for place, _ in source.reads] == [4, 5, 6]
    assert {name for _, name in source.reads} == {"prefetch"}
    assert fetcher[5].index == 105
    assert len(source.reads) == 3
    fetcher.close()


def test_memory_is_bounded_and_the_oldest_goes_first() -> None:
    source = SlowSequence()
    fetcher = Prefetcher(source, capacity=3)
    for place in (0, 1, 2, 0, 3):
        assert fetcher[place].index == 100 + place
    assert [fetcher.peek(place) is not None for place in range(4)] == [True, False, True, True]
    fetcher.wish(range(20))
    eventually(lambda: fetcher.peek(2) is not None and fetcher.peek(1) is not None)
    time.sleep(0.05)
    assert sum(fetcher.peek(place) is not None for place in range(20)) == 3
    fetcher.close()


def test_a_new_wish_replaces_the_old_one() -> None:
    source = SlowSequence()
    source.gate.clear()
    fetcher = Prefetcher(source)
    fetcher.wish(range(10))
    eventually(lambda: bool(source.reads))
    fetcher.wish([15])
    source.gate.set()
    eventually(lambda: fetcher.peek(15) is not None)
    assert [place for place, _ in source.reads] == [0, 15]
    fetcher.close()


def test_a_frame_being_decoded_is_waited_for_not_decoded_twice() -> None:
    source = SlowSequence()
    source.gate.clear()
    fetcher = Prefetcher(source)
    fetcher.wish([7])
    eventually(lambda: bool(source.reads))
    threading.Timer(0.05, source.gate.set).start()
    assert fetcher[7].index == 107
    assert len(source.reads) == 1
    fetcher.close()


def test_an_error_reaches_who_asks_and_stops_nothing() -> None:
    source = SlowSequence(broken=frozenset({2}))
    fetcher = Prefetcher(source)
    fetcher.wish([2, 3])
    eventually(lambda: fetcher.peek(3) is not None)
    for _ in range(2):
        with pytest.raises(SequenceError, match="frame 2 is broken"):
            fetcher.peek(2)
        with pytest.raises(SequenceError, match="frame 2 is broken"):
            fetcher[2]
    fetcher.close()
    assert fetcher[9].index == 109


def test_many_threads_get_the_right_frames() -> None:
    source = SlowSequence()
    fetcher = Prefetcher(source, capacity=4)
    wrong: list[tuple[int, int]] = []

    def read(seed: int) -> None:
        rng = np.random.default_rng(seed)
        for place in rng.integers(0, 20, 200).tolist():
            fetcher.wish([place + 1, place + 2])
            frame = fetcher[place]
            if frame.index != 100 + place or frame.rgb[0, 0, 0] != place:
                wrong.append((place, frame.index))

    threads = [threading.Thread(target=read, args=(seed,)) for seed in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(20)
    assert not any(thread.is_alive() for thread in threads)
    assert wrong == []
    fetcher.close()


def test_capacity_must_hold_a_frame() -> None:
    with pytest.raises(ValueError, match="at least 1, got 0"):
        Prefetcher(SlowSequence(), capacity=0)
