"""Typed access to a YAML mapping, with errors that name the place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any, cast

import numpy as np
import yaml

from asdfviz.errors import AssemblyError
from asdfviz.geometry.shapes import Scores, Transform
from asdfviz.geometry.transforms import is_rigid, orthonormalized


class _EachKeyOnce(yaml.SafeLoader):
    """Refuses a mapping that names a key twice, of which YAML would keep the last one in silence."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[object] = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"'{key.value}' is there twice", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def load_yaml(text: str) -> Any:
    """Read YAML of plain values, each key once.

    Raises:
        yaml.YAMLError: it is none, with the line, or nested deeper than Python follows.
    """
    try:
        return yaml.load(text, Loader=_EachKeyOnce)
    except RecursionError as error:
        raise yaml.YAMLError("it is nested too deeply") from error


@dataclass(frozen=True)
class Fields:
    """A mapping from a file and where it stands in it."""

    content: Any
    where: str

    def __post_init__(self) -> None:
        if not isinstance(self.content, Mapping):
            raise AssemblyError(f"{self.where}: expected a mapping, got {self.content!r}")

    def only(self, *known: str) -> None:
        """Refuse keys that nobody reads: a slip of the pen would change the meaning in silence."""
        for key in map(str, cast(Mapping[object, object], self.content)):
            if key not in known:
                near = get_close_matches(key, known, n=1, cutoff=0.7)
                hint = f"did you mean '{near[0]}'?" if near else f"known: {', '.join(known)}"
                raise AssemblyError(f"{self.where}: unknown key '{key}'; {hint}")

    def span(self, key: str) -> tuple[float, float]:
        """Two numbers, the lower one first; 0 and 0 when absent."""
        low, high = self.numbers(key, 2, default=(0, 0))
        if low > high:
            raise AssemblyError(
                f"{self.where}: '{key}' goes from {low:g} to {high:g}; give the lower end first"
            )
        return float(low), float(high)

    def _get(self, key: str, default: object) -> object:
        value = cast(Mapping[str, object], self.content).get(key, default)
        if value is None:
            if default is None:
                raise AssemblyError(f"{self.where}: '{key}' is missing")
            return default
        return value

    def text(self, key: str, *, default: str | None = None) -> str:
        """A string; YAML numbers count as their text."""
        value = self._get(key, default)
        if isinstance(value, (Mapping, list, bool)):
            raise AssemblyError(f"{self.where}: '{key}' must be text, got {value!r}")
        return str(value)

    def choice(self, key: str, options: tuple[str, ...], *, default: str | None = None) -> str:
        """One of a few strings."""
        value = self.text(key, default=default)
        if value not in options:
            raise AssemblyError(f"{self.where}: '{key}' is '{value}', use {' or '.join(options)}")
        return value

    def integer(self, key: str, *, default: int) -> int:
        """A whole number."""
        value = self._get(key, default)
        if not isinstance(value, int) or isinstance(value, bool):
            raise AssemblyError(f"{self.where}: '{key}' must be a whole number, got {value!r}")
        return value

    def mapping(self, key: str) -> Mapping[str, Any]:
        """A mapping, empty when absent."""
        value = self._get(key, {})
        if not isinstance(value, Mapping):
            raise AssemblyError(f"{self.where}: '{key}' must be a mapping, got {value!r}")
        return {str(k): v for k, v in cast(Mapping[Any, Any], value).items()}

    def sequence(self, key: str) -> Sequence[Any]:
        """A list, empty when absent."""
        value = self._get(key, [])
        if not isinstance(value, list):
            raise AssemblyError(f"{self.where}: '{key}' must be a list, got {value!r}")
        return cast(list[Any], value)

    def numbers(
        self, key: str, count: int, *, default: Sequence[float | int] | None = None
    ) -> Scores:
        """A list of finite numbers of a given length."""
        return self._numbers(self._get(key, default), count, f"'{key}'")

    def _numbers(self, value: object, count: int, what: str) -> Scores:
        try:
            array = np.asarray(value, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError, OverflowError) as error:
            raise AssemblyError(f"{self.where}: {what} must be {count} numbers") from error
        if len(array) != count or not np.isfinite(array).all():
            raise AssemblyError(
                f"{self.where}: {what} must be {count} finite numbers, got {value!r}"
            )
        return array

    def transform_row(self, row: object, scale: float) -> Transform:
        """16 numbers, row by row, as a rigid transform with its translation scaled to metres."""
        return self._rigid(self._numbers(row, 16, "a transform").reshape(4, 4).copy(), scale)

    def pose(self, scale: float) -> Transform:
        """`R` (9 numbers) and `t` (3 numbers) as a rigid transform in metres."""
        T = np.eye(4)
        T[:3, :3] = self.numbers("R", 9, default=np.eye(3).reshape(-1).tolist()).reshape(3, 3)
        T[:3, 3] = self.numbers("t", 3, default=(0, 0, 0))
        return self._rigid(T, scale)

    def _rigid(self, T: Transform, scale: float) -> Transform:
        T[:3, 3] *= scale
        if not is_rigid(T, tolerance=1e-2):
            R = T[:3, :3].round(4).tolist()
            raise AssemblyError(
                f"{self.where}: not a rotation and a translation: R is {R} with determinant "
                f"{np.linalg.det(T[:3, :3]):.4g}; give it row by row with R R^T = 1"
            )
        return orthonormalized(T)
