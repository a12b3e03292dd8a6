"""Work that is shared among threads."""

import threading

import pytest

from asdfviz.geometry import threads
from asdfviz.geometry.threads import side_by_side


@pytest.fixture(params=[1, 2, 3])
def cores(request, monkeypatch) -> int:
    monkeypatch.setattr(threads.os, "sched_getaffinity", lambda _: set(range(request.param)))
    return request.param


@pytest.mark.parametrize("count", [0, 1, 2, 5, 8])
def test_results_keep_the_order_of_the_items(cores: int, count: int) -> None:
    assert side_by_side(lambda x: 10 * x, range(count)) == [10 * x for x in range(count)]


def test_several_threads_work_at_once(cores: int) -> None:
    meet = threading.Barrier(cores, timeout=20)
    assert side_by_side(lambda x: meet.wait() >= 0, range(cores)) == [True] * cores


def test_an_error_comes_out(cores: int) -> None:
    def fail(x: int) -> int:
        return 1 // (x - 3)

    with pytest.raises(ZeroDivisionError):
        side_by_side(fail, range(5))
