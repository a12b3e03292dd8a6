"""The one thread that talks to OpenGL, and the loading of pyrender with its three repairs.

An EGL context belongs to the thread that made it, and every viser callback runs in a thread of
its own, so all drawing in the process is queued to this thread.
"""

from __future__ import annotations

import importlib
import os
import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from asdfviz.errors import RenderError

Result = TypeVar("Result")

APT_PACKAGES = "libegl1 libgl1-mesa-dri"


@dataclass(frozen=True)
class Pyrender:
    """The parts of pyrender that this package draws with."""

    pyrender: Any
    renderer: Any
    egl: Any
    flags: Any


def load_pyrender() -> Pyrender:
    """Import pyrender on EGL, repaired for NumPy 2.

    Raises:
        RenderError: EGL or Mesa is not installed.
    """
    # pyrender 0.1.45 computes bounds with np.infty, which NumPy 2 dropped.
    if not hasattr(np, "infty"):
        setattr(np, "infty", np.inf)  # noqa: B010
    # PyOpenGL picks its platform while it is imported.
    os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
    try:
        module = importlib.import_module("pyrender")
        return Pyrender(
            pyrender=module,
            renderer=importlib.import_module("pyrender.renderer"),
            egl=importlib.import_module("pyrender.platforms.egl"),
            flags=module.RenderFlags,
        )
    except Exception as error:
        # A missing libEGL shows as ImportError, AttributeError or OSError, by PyOpenGL's version.
        raise no_opengl(error) from error


def no_opengl(cause: Exception) -> RenderError:
    """The error for a machine without a usable EGL."""
    return RenderError(
        f"OpenGL without a display (EGL) cannot be used here: {cause!r}; "
        f"install it with: apt-get install {APT_PACKAGES}"
    )


class RenderThread:
    """Runs functions one after the other in a thread of its own."""

    def __init__(self) -> None:
        self._jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._process = os.getpid()
        # Daemonic: it outlives every other thread and so can still free things at exit.
        self._thread = threading.Thread(target=self._work, name="asdfviz-render", daemon=True)
        self._thread.start()

    def call(self, function: Callable[[], Result]) -> Result:
        """Run `function` in the render thread and return what it returns or raises.

        Raises:
            RenderError: the process was forked after rendering began; EGL would hang.
        """
        if threading.current_thread() is self._thread:
            return function()
        if os.getpid() != self._process:
            raise RenderError(
                "rendering began before this process was forked, which OpenGL does not survive; "
                "start worker processes with the 'spawn' method"
            )
        future: Future[Result] = Future()

        def job() -> None:
            try:
                future.set_result(function())
            except BaseException as error:  # noqa: BLE001
                # The caller's thread raises it.
                future.set_exception(error)

        self._jobs.put(job)
        return future.result()

    def _work(self) -> None:
        while True:
            self._jobs.get()()


_lock = threading.Lock()
_threads: list[RenderThread] = []


def render_thread() -> RenderThread:
    """The process's render thread, started at first use."""
    with _lock:
        if not _threads:
            _threads.append(RenderThread())
        return _threads[0]
