"""Work that only leaves marks; spawned processes import it, so it imports little itself."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from asdfviz.errors import InputError


@dataclass(frozen=True)
class Marks:
    """Leaves a file a piece; number 3 can be told to fail or to die."""

    folder: Path
    mishap: str = ""
    token: str = "marks"

    def open(self) -> Callable[[int, object], None]:
        return self._mark

    def _mark(self, number: int, stop: object) -> None:
        if number == 3 and self.mishap == "error":
            raise InputError("piece 3 is wrong")
        if number == 3 and self.mishap == "death":
            os._exit(9)
        (self.folder / str(number)).write_text(str(os.getpid()))


@dataclass(frozen=True)
class Threads:
    """Leaves the number of torch's threads a piece."""

    folder: Path
    token: str = "threads"

    def open(self) -> Callable[[int, object], None]:
        import torch

        def count(number: int, stop: object) -> None:
            (self.folder / str(number)).write_text(str(torch.get_num_threads()))

        return count
