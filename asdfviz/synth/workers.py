"""Does numbered pieces of work here, in spawned processes, or through joblib on other machines.

Each piece depends on nothing but its number and leaves complete files behind, so the order and the
place do not matter, and a job that was stopped or killed goes on. Processes are spawned, never
forked: an OpenGL or CUDA context dies with a fork.
"""

from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from multiprocessing.context import SpawnProcess
from multiprocessing.synchronize import Event
from typing import Any, Protocol, TypeAlias, runtime_checkable

import cv2

from asdfviz.errors import AsdfvizError, InputError

Stop: TypeAlias = Callable[[], bool]
Piece: TypeAlias = Callable[[int, Stop], None]
"""Does the piece of a number; long pieces ask now and then whether to stop."""

BACKENDS = ("loky", "dask", "ray")
"""joblib's engines that can be named: processes here, or a cluster's."""
POLL_S = 0.5
"""Time between two looks at whether somebody asked to stop, seconds."""


@runtime_checkable
class Work(Protocol):
    """Work that can be sent to another process."""

    @property
    def token(self) -> str:
        """Different for every job: a process keeps what `open` returned under this name."""
        ...

    def open(self) -> Piece:
        """Prepare what all pieces need; happens once in every process."""
        ...


@dataclass(frozen=True, slots=True)
class Crew:
    """Who does the work."""

    workers: int = 1
    """Processes; 1 works in this one unless a backend is named."""
    backend: str | None = None
    """One of BACKENDS, for joblib; None spawns the processes here."""

    def check(self) -> None:
        """Refuse what cannot be.

        Raises:
            InputError: the number of workers or the backend.
        """
        if self.workers < 1:
            raise InputError(f"{self.workers} workers: use 1 or more")
        if self.backend is not None and self.backend not in BACKENDS:
            raise InputError(f"no joblib backend '{self.backend}'; use {', '.join(BACKENDS)}")


def do_all(
    work: Work,
    numbers: Sequence[int],
    *,
    crew: Crew | None = None,
    tick: Callable[[int], None] | None = None,
    stop: Stop | None = None,
) -> bool:
    """Do the pieces of all numbers; pieces that were begun are finished when stopped.

    Args:
        work: what to do.
        numbers: of the pieces.
        crew: processes and engine; by default this process alone.
        tick: called with the number of finished pieces, whenever it grows and now and then.
        stop: asked now and then; true ends the job.

    Returns:
        Whether everything was done.

    Raises:
        InputError: the crew cannot be, or joblib or its engine is not installed.
        AsdfvizError: a process died, or what a piece raised.
    """
    chosen = crew or Crew()
    chosen.check()
    asked = stop or _never
    if chosen.backend is not None:
        finished = _with_joblib(work, numbers, chosen.workers, chosen.backend, asked)
    elif chosen.workers > 1 and len(numbers) > 1:
        finished = _with_processes(work, numbers, chosen.workers, asked)
    else:
        finished = _here(work, numbers, asked, tick or _nothing)
    done = 0
    # Closed here, and not whenever the garbage collector comes, so that processes end in order.
    with closing(finished):
        for done in finished:
            if tick is not None:
                tick(done)
    return done == len(numbers)


def _never() -> bool:
    return False


def _nothing(_: int) -> None:
    pass


def _here(
    work: Work, numbers: Sequence[int], stop: Stop, tick: Callable[[int], None]
) -> Generator[int]:
    if not numbers:
        return
    piece = work.open()
    for done, number in enumerate(numbers):

        def look(done: int = done) -> bool:
            tick(done)
            return stop()

        if stop():
            return
        piece(number, look)
        if stop():
            # A long piece may have ended early.
            return
        yield done + 1


_opened: dict[str, Piece] = {}
"""What this process keeps of the work it was sent, by token."""
_stop_event: list[Event] = []
"""Set in spawned processes: the parent's wish to stop."""


def _asked_to_stop() -> bool:
    return bool(_stop_event) and _stop_event[0].is_set()


def _do(work: Work, number: int) -> bool:
    """Runs in another process; returns whether the piece was done."""
    if _asked_to_stop():
        return False
    if work.token not in _opened:
        _opened.clear()
        _opened[work.token] = work.open()
    _opened[work.token](number, _asked_to_stop)
    return not _asked_to_stop()


def _with_processes(work: Work, numbers: Sequence[int], workers: int, stop: Stop) -> Generator[int]:
    context = multiprocessing.get_context("spawn")
    event = context.Event()
    count = min(workers, len(numbers))
    done = 0
    with ProcessPoolExecutor(count, context, _prepare, (event, count)) as pool:
        with _held_back(signal.SIGINT):
            pending = {pool.submit(_do, work, number) for number in numbers}
        try:
            while pending:
                finished, pending = wait(pending, POLL_S, FIRST_COMPLETED)
                done += sum(future.result() for future in finished)
                yield done
                if stop() and not event.is_set():
                    event.set()
        except BrokenProcessPool as error:
            if not stop():  # SIGTERM may go to all processes
                raise AsdfvizError(
                    "a worker process died (out of memory?); try fewer --workers: the job goes on"
                ) from error
        finally:
            # Reached by an error or Ctrl+C too: what waits in the queue then ends at once.
            event.set()
            pool.shutdown(wait=True, cancel_futures=True)


def _prepare(event: Event, workers: int) -> None:
    """Begin a spawned process: its share of the cores, and no life after its parent's."""
    _stop_event[:] = [event]
    _prepare_threads(max(1, len(os.sched_getaffinity(0)) // workers))


@contextmanager
def spawned(
    target: Callable[..., None], arguments: Sequence[tuple[Any, ...]]
) -> Generator[list[SpawnProcess]]:
    """Let processes run beside the body: one of `target` for each tuple of arguments, ended after it.

    Each has one thread of torch and of OpenCV, and no life after this process's.
    """
    context = multiprocessing.get_context("spawn")
    processes: list[SpawnProcess] = []
    try:
        with _held_back(signal.SIGINT, signal.SIGTERM):
            for given in arguments:
                process = context.Process(target=_beside, args=(target, *given), daemon=True)
                process.start()
                processes.append(process)
        yield processes
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.join()


def _beside(target: Callable[..., None], *given: Any) -> None:
    _prepare_threads(1)
    target(*given)


def _prepare_threads(threads: int) -> None:
    # For torch, which work imports if it needs it. Where the script that began the job did, that is too
    # late, and threads in excess wait for each other ten times longer than they work.
    os.environ["OMP_NUM_THREADS"] = str(threads)
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(threads)
    cv2.setNumThreads(threads)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _held_back(*signals: signal.Signals) -> Generator[None]:
    """Processes that start within never see these: their parent hears them and ends all in order."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _with_joblib(
    work: Work, numbers: Sequence[int], workers: int, backend: str, stop: Stop
) -> Generator[int]:
    joblib = _module("joblib")
    # Ray's engine gives no result before the last one, so it gets small batches.
    kind, batch = ("list", 4 * workers) if backend == "ray" else ("generator_unordered", 0)
    batch = batch or max(len(numbers), 1)
    done = 0
    with _cluster(backend, workers), joblib.parallel_config(backend=backend, n_jobs=workers):
        for first in range(0, len(numbers), batch):
            tasks = [joblib.delayed(_do)(work, n) for n in numbers[first : first + batch]]
            with _held_back(signal.SIGINT):
                results = joblib.Parallel(return_as=kind)(tasks)
            for finished in results:
                done += finished
                yield done
                if stop():
                    return  # tasks that have not begun go with the generator


@contextmanager
def _cluster(backend: str, workers: int) -> Generator[None]:
    """Join the cluster that the engine's own settings name, or start processes on this machine."""
    if backend == "ray":
        # Reads RAY_ADDRESS.
        _module("ray.util.joblib").register_ray()
    if backend != "dask":
        yield
        return
    distributed, dask = _module("distributed"), _module("dask")
    # Set by DASK_SCHEDULER_ADDRESS or a file of Dask's.
    named = dask.config.get("scheduler-address", None) is not None
    here = {} if named else {"n_workers": workers, "threads_per_worker": 1}
    with _held_back(signal.SIGINT):
        client = distributed.Client(**here)
    with client:
        yield


def _module(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            f"{name.partition('.')[0]} is not installed here: pip install 'asdfviz[cluster]' brings "
            "joblib; dask (with distributed) and ray come by their own names"
        ) from error
