"""Names of files and folders that can be written down: runs and corrections keep where they belong to."""

from __future__ import annotations

from pathlib import Path

from asdfviz.errors import InputError


def check_name(path: Path, *, error: type[InputError] = InputError) -> None:
    """Refuse a path that is no text, before work goes into what has to name it.

    Raises:
        InputError: or the kind that is given; a name on the way to it is not UTF-8.
    """
    whole = path.absolute()
    for name in whole.parts:
        try:
            name.encode("utf-8")
        except UnicodeEncodeError as fault:
            raise error(
                f"{str(whole)!r}: the name {name!r} is not UTF-8, so no file could name it; "
                "give it another name"
            ) from fault
