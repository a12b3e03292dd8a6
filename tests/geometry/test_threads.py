"""Work that is shared among threads."""

import threading
import time

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


def test_the_error_of_the_first_item_that_fails_comes_out(cores: int) -> None:
    def fail(x: int) -> int:
        if x in (1, 2):
            raise ValueError(f"item {x}")
        return x

    with pytest.raises(ValueError, match="item 1"):
        side_by_side(fail, range(4))


@pytest.mark.parametrize("failing", [0, 1])
def test_no_work_goes_on_once_an_error_is_out(cores: int, failing: int) -> None:
    running: set[int] = set()

    def fail(x: int) -> None:
        if x == failing:
            time.sleep(0.02)
            raise ValueError("failed")
        running.add(x)
        time.sleep(0.1)
        running.remove(x)

    with pytest.raises(ValueError, match="failed"):
        side_by_side(fail, range(3))
    assert not running
