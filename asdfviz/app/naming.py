"""Names as short as a narrow list needs them: without what all of them begin with. Pure."""

from __future__ import annotations

import os
import re
from collections.abc import Collection

_SEPARATORS = re.compile(r"[_\-. ]+")


def short_names(names: Collection[str]) -> dict[str, str]:
    """What tells each name of a list from the others, by name.

    The shared beginning is cut behind a separator, and so that no name is left empty or a bare number.
    """
    if len(names) < 2:
        return {name: name for name in names}
    shared = os.path.commonprefix(list(names))
    cuts = [0, *(found.end() for found in _SEPARATORS.finditer(shared))]
    cut = next(at for at in reversed(cuts) if at == 0 or all(_says(name[at:]) for name in names))
    return {name: name[cut:] for name in names}


def _says(rest: str) -> bool:
    return bool(rest) and not rest.isdecimal()
