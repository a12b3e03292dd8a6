"""Work in a thread of its own behind one of the workspace's two statuses. Nothing here knows viser."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Literal

from asdfviz.app.items import PROGRAM_FAULT, JobStatus
from asdfviz.app.workspace import Workspace
from asdfviz.errors import AsdfvizError


class BackgroundJob(ABC):
    """Begins, is asked to stop, and always ends with a status that is no longer active."""

    def __init__(
        self, workspace: Workspace, slot: Literal["job", "carrying"], *, thread: str
    ) -> None:
        """Get ready.

        Args:
            workspace: whose status tells how far it is.
            slot: which of its statuses that is.
            thread: name of the thread.
        """
        self._workspace = workspace
        self._slot = slot
        self._stopped = threading.Event()
        self._lock = threading.Lock()
        """Held while the status changes, so that a stop never overwrites an end."""
        self._thread = threading.Thread(target=self._guarded, name=thread, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def stop(self) -> None:
        """Ask to stop at the next frame."""
        self._stopped.set()
        with self._lock:
            status = self._status
            if status is not None and status.state == "running":
                setattr(self._workspace, self._slot, replace(status, state="stopping"))
        self._workspace.changed()

    def wait(self, seconds: float | None = None) -> None:
        """Wait for the end."""
        self._thread.join(seconds)

    @abstractmethod
    def _work(self) -> None:
        """Do it, and set the status at the end."""

    @abstractmethod
    def _fail(self, message: str) -> None:
        """Tell why it failed, and set the status so."""

    @property
    def _status(self) -> JobStatus | None:
        return getattr(self._workspace, self._slot)

    @property
    def _state(self) -> Literal["running", "stopping"]:
        return "stopping" if self._stopped.is_set() else "running"

    def _set(self, status: JobStatus) -> None:
        with self._lock:
            setattr(self._workspace, self._slot, status)
        self._workspace.changed()

    def _guarded(self) -> None:
        try:
            self._work()
        except (AsdfvizError, OSError) as error:
            self._fail(str(error))
        finally:
            # Else it would seem to work for good, and no other could begin.
            if self._status is not None and self._status.is_active:
                self._fail(PROGRAM_FAULT)
