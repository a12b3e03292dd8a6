"""A method's options as a form shows them: found in its config dataclass, read back from text. Pure.

Every field that can be chosen becomes one line: its name, its default, and its docstring as the hint.
Nested dataclasses are the groups; names are dotted as on the command line (`detector.confidence`).
"""

from __future__ import annotations

import ast
import dataclasses
import functools
import inspect
import math
import textwrap
import types
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

from asdfviz.errors import MethodError

Kind = Literal["switch", "whole", "number", "choice", "text"]
_KINDS: dict[type, Kind] = {
    bool: "switch",
    int: "whole",
    float: "number",
    str: "text",
    Path: "text",
}


def label_of(name: str) -> str:
    """The last part of an option's dotted name, in words."""
    return name.rpartition(".")[2].replace("_", " ")


@dataclass(frozen=True, slots=True)
class Option:
    """One line of the form."""

    name: str
    """Dotted, as on the command line."""
    kind: Kind
    default: str
    """As text; empty for None."""
    hint: str
    choices: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """The last part of the name, in words."""
        return label_of(self.name)


@dataclass(frozen=True, slots=True)
class Group:
    """The options of one nested config; the first group holds the config's own."""

    name: str
    hint: str
    options: tuple[Option, ...]


@functools.lru_cache(maxsize=64)
def option_groups(config: type) -> tuple[Group, ...]:
    """The options of a config class, group by group; fields of other types are left out."""
    return tuple(group for group in _groups(config(), "", "") if group.options)


def config_from(config: type, given: Mapping[str, str]) -> object:
    """The config with the given options changed.

    Raises:
        MethodError: there is no such option, or the text is not of its type.
    """
    known = {option.name: option for group in option_groups(config) for option in group.options}
    unknown = [name for name in given if name not in known]
    if unknown:
        raise MethodError(f"there is no option '{unknown[0]}'; options: {', '.join(known)}")
    return _replaced(config(), "", given)


def differences(default: object, config: Mapping[str, object]) -> dict[str, str]:
    """The options of a saved config that are not as in `default`, by name, as text."""
    usual = _flat(dataclasses.asdict(cast(Any, default)))
    return {
        name: _text(value)
        for name, value in _flat(config).items()
        if name in usual and _text(usual[name]) != _text(value)
    }


def _groups(config: Any, prefix: str, hint: str) -> list[Group]:
    made_by: type = config.__class__
    hints, types_ = _docstrings(made_by), get_type_hints(made_by)
    own: list[Option] = []
    below: list[Group] = []
    for field in _chosen(config):
        value = getattr(config, field.name)
        name = f"{prefix}{field.name}"
        said = hints.get(field.name, "")
        if dataclasses.is_dataclass(value):
            below += _groups(value, f"{name}.", said)
            continue
        kind, choices = _kind(types_[field.name])
        if kind is not None:
            own.append(Option(name, kind, _text(value), said, choices))
    return [Group(prefix.rstrip("."), hint, tuple(own)), *below]


def _chosen(config: Any) -> list[dataclasses.Field[Any]]:
    """The fields that can be chosen; others stay as the method has them."""
    return [field for field in dataclasses.fields(config) if field.init]


def _kind(hint: Any) -> tuple[Kind | None, tuple[str, ...]]:
    said = _said(hint)
    if get_origin(said) is Literal:
        usual = () if said is hint else ("",)
        return "choice", (*usual, *(str(choice) for choice in get_args(said)))
    return _KINDS.get(said), ()


def _said(hint: Any) -> Any:
    """The type of what can be said, where nothing may be said as well; None where it has several."""
    if get_origin(hint) not in (types.UnionType, Union):
        return hint
    inner = [kind for kind in get_args(hint) if kind is not type(None)]
    return inner[0] if len(inner) == 1 else None


def _replaced(config: Any, prefix: str, given: Mapping[str, str]) -> Any:
    types_ = get_type_hints(config.__class__)
    changes: dict[str, Any] = {}
    for field in _chosen(config):
        value, name = getattr(config, field.name), f"{prefix}{field.name}"
        if dataclasses.is_dataclass(value):
            changes[field.name] = _replaced(value, f"{name}.", given)
        elif name in given:
            changes[field.name] = _value(given[name].strip(), types_[field.name], name)
    return dataclasses.replace(config, **changes)


def _value(said: str, hint: Any, name: str) -> object:
    kind, choices = _kind(hint)
    if not said and type(None) in get_args(hint):
        return None
    if kind == "choice":
        for choice in get_args(_said(hint)):
            if str(choice) == said:
                return choice
        raise MethodError(f"{name} is '{said}': choose {' or '.join(filter(None, choices))}")
    if kind == "switch":
        return said == "True"
    if kind in ("whole", "number"):
        return _number(said, name, whole=kind == "whole")
    return Path(said).expanduser() if Path in (hint, *get_args(hint)) else said


def _number(said: str, name: str, *, whole: bool) -> int | float:
    try:
        number = int(said) if whole else float(said)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise MethodError(f"{name} is '{said}': give a {'whole ' if whole else ''}number")
    return number


def _docstrings(config: type) -> dict[str, str]:
    """The string below each field of a dataclass, on one line."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(config))).body[0]
    except (OSError, TypeError, SyntaxError):
        return {}  # made by a program: it has no source
    lines = tree.body if isinstance(tree, ast.ClassDef) else []
    found: dict[str, str] = {}
    for field, below in pairwise(lines):
        is_field = isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        says = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        if is_field and says:
            name = cast(ast.Name, cast(ast.AnnAssign, field).target).id
            constant = cast(ast.Constant, cast(ast.Expr, below).value)
            found[name] = " ".join(str(constant.value).split())
    return found


def _flat(config: Mapping[str, object], prefix: str = "") -> dict[str, object]:
    flat: dict[str, object] = {}
    for name, value in config.items():
        if isinstance(value, Mapping):
            flat |= _flat(cast(Mapping[str, object], value), f"{prefix}{name}.")
        else:
            flat[f"{prefix}{name}"] = value
    return flat


def _text(value: object) -> str:
    if isinstance(value, list | tuple):  # a saved config has lists for tuples
        return ", ".join(_text(one) for one in cast("list[object] | tuple[object, ...]", value))
    return "" if value is None else str(value)
