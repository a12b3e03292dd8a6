"""Names as short as a narrow list needs them: without what all of them begin with. Pure."""

from __future__ import annotations

import re
from collections.abc import Collection

_SEPARATORS = re.compile(r"[_\-. ]+")


def short_names(names: Collection[str]) -> dict[str, str]:
    """What tells each name of a list from the others, by name.

    The shared beginning is cut behind a separator, and so that no name is left empty or a bare number.
    """
    if len(names) < 2:
        return {name: name for name in names}
    first = next(iter(names))
    cuts = (found.end() for found in _SEPARATORS.finditer(first))
    cut = max((at for at in cuts if all(_is_cut(name, first[:at]) for name in names)), default=0)
    return {name: name[cut:] for name in names}


def _is_cut(name: str, shared: str) -> bool:
    rest = name.removeprefix(shared)
    return bool(rest) and not rest.isdecimal() and rest != name
