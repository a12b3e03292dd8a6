"""Decodes frames ahead of time on a thread of its own, so that playing never waits for the disk."""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Iterable

from asdfviz.datatypes import Assembly, Camera, Frame, FrameTruth, Sequence
from asdfviz.errors import SequenceError


class Prefetcher:
    """A sequence that keeps the frames last used and fetches wished ones in the background.

    It is a Sequence itself. Every method may be called from any thread. Memory stays bounded: a
    1280 x 720 frame takes 6.5 MB.
    """

    def __init__(self, source: Sequence, *, capacity: int = 32) -> None:
        if capacity < 1:
            raise ValueError(f"capacity must be at least 1, got {capacity}")
        self.source = source
        self._capacity = capacity
        self._cache: OrderedDict[int, Frame | SequenceError] = OrderedDict()
        self._wishes: deque[int] = deque()
        self._busy: set[int] = set()
        self._is_closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="prefetch", daemon=True)
        self._thread.start()

    @property
    def name(self) -> str:
        """Name of the sequence behind."""
        return self.source.name

    @property
    def path(self) -> str:
        """Path of the sequence behind."""
        return self.source.path

    @property
    def assembly(self) -> Assembly | None:
        """Assembly of the sequence behind."""
        return self.source.assembly

    @property
    def camera(self) -> Camera:
        """Camera of the sequence behind."""
        return self.source.camera

    @property
    def frame_indices(self) -> tuple[int, ...]:
        """Frame numbers of the sequence behind."""
        return self.source.frame_indices

    def truth(self, place: int) -> FrameTruth | None:
        """Truth of the sequence behind."""
        return self.source.truth(place)

    def __len__(self) -> int:
        return len(self.source)

    def __getitem__(self, place: int) -> Frame:
        """The frame at a place, at once if it is there already, otherwise decoded in this thread.

        Raises:
            IndexError: there is no such place.
            SequenceError: the frame cannot be read.
        """
        place = range(len(self))[place]
        with self._changed:
            while place in self._busy:
                self._changed.wait()
            if place in self._cache:
                self._cache.move_to_end(place)
                return _frame(self._cache[place])
            self._busy.add(place)
        return _frame(self._fetch(place))

    def peek(self, place: int) -> Frame | None:
        """The frame at a place if it is decoded already; None otherwise. Never waits for the disk.

        Raises:
            SequenceError: the frame was tried and cannot be read.
        """
        with self._changed:
            found = self._cache.get(place)
        return None if found is None else _frame(found)

    def wish(self, places: Iterable[int]) -> None:
        """Replace what is fetched next, most urgent first; places outside the sequence are left out."""
        inside = [place for place in dict.fromkeys(places) if 0 <= place < len(self)]
        with self._changed:
            # More than fits would push out what was fetched for this very wish.
            self._wishes = deque(inside[: self._capacity])
            self._changed.notify_all()

    def close(self) -> None:
        """Stop the thread; frames can still be read."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
        self._thread.join()

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._wishes and not self._is_closed:
                    self._changed.wait()
                if self._is_closed:
                    return
                place = self._wishes.popleft()
                if place in self._cache:
                    self._cache.move_to_end(place)
                    continue
                if place in self._busy:
                    continue
                self._busy.add(place)
            self._fetch(place)

    def _fetch(self, place: int) -> Frame | SequenceError:
        """Decode a place that this thread has marked busy, and keep what came of it."""
        try:
            found = _read(self.source, place)
        except BaseException:
            self._settle(place, None)
            raise
        self._settle(place, found)
        return found

    def _settle(self, place: int, found: Frame | SequenceError | None) -> None:
        with self._changed:
            self._busy.discard(place)
            if found is not None:
                self._keep(place, found)
            self._changed.notify_all()

    def _keep(self, place: int, found: Frame | SequenceError) -> None:
        self._cache[place] = found
        self._cache.move_to_end(place)
        while len(self._cache) > self._capacity:
            self._cache.popitem(last=False)


def _read(source: Sequence, place: int) -> Frame | SequenceError:
    try:
        return source[place]
    except SequenceError as error:
        return error


def _frame(found: Frame | SequenceError) -> Frame:
    if isinstance(found, SequenceError):
        # A fresh error each time: one object raised by two threads would mix their tracebacks.
        raise type(found)(*found.args)
    return found
