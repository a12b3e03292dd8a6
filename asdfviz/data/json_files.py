"""Typed access to JSON from outside; whatever is wrong is one error that names the file and the key."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np

from asdfviz.errors import InputError
from asdfviz.geometry.shapes import Scores


@dataclass(frozen=True, slots=True)
class Json:
    """A JSON value, where it stands, and the error to raise when it is not what it should be."""

    value: object
    where: str
    error: type[InputError]

    def fail(self, wanted: str) -> InputError:
        """An error to raise: what is here and what would be right."""
        shown = repr(self.value)
        shown = shown if len(shown) <= 80 else shown[:77] + "..."
        return self.error(f"{self.where}: expected {wanted}, got {shown}")

    def items(self) -> dict[str, Json]:
        """The members of an object."""
        members = self.value
        if not isinstance(members, dict):
            raise self.fail("an object {...}")
        members = cast(Mapping[str, object], members)
        return {k: Json(v, f"{self.where}: '{k}'", self.error) for k, v in members.items()}

    def entries(self) -> list[Json]:
        """The members of a list."""
        members = self.value
        if not isinstance(members, list):
            raise self.fail("a list [...]")
        members = cast(list[object], members)
        return [Json(v, f"{self.where}[{i}]", self.error) for i, v in enumerate(members)]

    def find(self, key: str) -> Json | None:
        """A member of an object; None where it is absent or null."""
        member = self.items().get(key)
        return None if member is None or member.value is None else member

    def get(self, key: str) -> Json:
        """A member of an object that must be there."""
        member = self.items().get(key)
        if member is not None and member.value is None:
            raise self.error(f"{self.where}: '{key}' is missing (it is null)")
        if member is None:
            known = ", ".join(self.items()) or "nothing"
            raise self.error(f"{self.where}: '{key}' is missing (found: {known})")
        return member

    def number(self) -> float:
        """A finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, (int, float)):
            raise self.fail("a number")
        try:
            number = float(self.value)
        except OverflowError as error:
            raise self.fail("a finite number") from error
        if not math.isfinite(number):
            raise self.fail("a finite number")
        return number

    def integer(self) -> int:
        """A whole number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            raise self.fail("a whole number")
        return self.value

    def boolean(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            raise self.fail("true or false")
        return self.value

    def text(self) -> str:
        """A string."""
        if not isinstance(self.value, str):
            raise self.fail("text")
        return self.value

    def numbers(self, *counts: int) -> Scores:
        """A list of so many finite numbers, or of one of several lengths (nested lists row by row)."""
        wanted = " or ".join(map(str, counts))
        try:
            array = np.asarray(self.value, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError, OverflowError) as error:
            raise self.fail(f"{wanted} numbers") from error
        if len(array) not in counts or not np.isfinite(array).all():
            raise self.fail(f"{wanted} finite numbers")
        return array


def parse_json(text: str, *, where: str, error: type[InputError]) -> Json:
    """Read JSON from a string.

    Raises:
        InputError: of the given kind, with the line and column of the fault; or it holds what is no text.
    """
    try:
        value = json.loads(text)
        # Only escapes can spell what is no text.
        strings = _strings(value) if "\\u" in text else ()
        bad = next((one for one in strings if not _is_text(one)), None)
    except (ValueError, RecursionError) as fault:
        raise error(f"{where} is not valid JSON: {fault}") from fault
    if bad is not None:
        raise error(
            f"{where} holds {bad[:80]!r}, which is no text: no file could be named or written so"
        )
    return Json(value, where, error)


def _strings(value: object) -> Iterator[str]:
    """Every string and key in a JSON value."""
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, member in cast(Mapping[str, object], value).items():
            yield key
            yield from _strings(member)
    elif isinstance(value, list):
        for member in cast(list[object], value):
            yield from _strings(member)


def _is_text(value: str) -> bool:
    """Whether UTF-8 can hold it, and a path: escapes can spell half a character, and none."""
    return "\0" not in value and not any("\ud800" <= c <= "\udfff" for c in value)


def read_json(path: Path, *, error: type[InputError]) -> Json:
    """Read a JSON file.

    Raises:
        InputError: of the given kind; the file is missing, not UTF-8 or not JSON.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError as fault:
        raise error(f"{path} does not exist") from fault
    except (OSError, UnicodeDecodeError) as fault:
        raise error(f"{path} cannot be read: {fault}") from fault
    return parse_json(text, where=str(path), error=error)
