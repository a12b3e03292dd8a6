"""Checks types and shapes at every call, in a fraction of the time that jaxtyping's decorator needs.

That one binds the arguments to the signature and checks them twice a call, which was near half of
what the tests took. Here beartype checks arguments and result once, in one jaxtyping context.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable
from types import FunctionType
from typing import Any, TypeVar, get_args, get_type_hints

import jaxtyping
from beartype import beartype

Anything = TypeVar("Anything")
_JAXTYPED = jaxtyping.jaxtyped
_CONTEXT = _JAXTYPED("context")


def install(package: str) -> None:
    """Check the modules of a package that are imported from here on.

    jaxtyping's import hook puts its decorator on every function and class; this one takes its place.
    """
    jaxtyping.jaxtyped = decorator  # pyright: ignore[reportAttributeAccessIssue]
    jaxtyping.install_import_hook(package, "beartype.beartype")


def decorator(*, typechecker: Callable[[Any], Any]) -> Callable[[Anything], Anything]:
    """What the hook calls: for functions and dataclasses; it leaves other classes as they are."""

    def decorate(thing: Any) -> Any:
        if isinstance(thing, FunctionType) and not _is_lazy(thing):
            return checked(thing)
        if inspect.isclass(thing) and dataclasses.is_dataclass(thing):
            thing.__init__ = checked(thing.__init__)
            return thing
        return _JAXTYPED(thing, typechecker=typechecker)

    return decorate


def checked(function: Any) -> Any:
    """The function, with its arguments and its result checked unless checks are turned off.

    Its hints are read now, as they are meant; the checks are made of them at its first call, which in
    most processes never comes for most functions.
    """
    if getattr(function, "__no_type_check__", False) or not function.__annotations__:
        return function
    hints = {name: _hint(hint, function) for name, hint in function.__annotations__.items()}
    in_context = any(_has_shape(hint) for hint in hints.values())
    strict: Any = None

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        __tracebackhide__ = True
        nonlocal strict
        if jaxtyping.config.jaxtyping_disable:
            return function(*args, **kwargs)
        if strict is None:
            strict = beartype(_with_hints(function, hints))
        if not in_context:
            return strict(*args, **kwargs)
        with _CONTEXT:
            return strict(*args, **kwargs)

    return call


def _is_lazy(function: FunctionType) -> bool:
    """Generators and coroutines: what they yield is not checked, which jaxtyping sees to."""
    kinds = (inspect.isgeneratorfunction, inspect.isasyncgenfunction, inspect.iscoroutinefunction)
    return any(is_kind(function) for is_kind in kinds)


def _hint(hint: object, function: FunctionType) -> Any:
    """A hint that may be a string; Any where it names what is not there yet, as in jaxtyping."""

    def named(value: object) -> None:
        del value

    named.__annotations__["value"] = hint
    try:
        return get_type_hints(named, function.__globals__, include_extras=True)["value"]
    except Exception:  # noqa: BLE001
        return Any


def _with_hints(function: FunctionType, hints: dict[str, Any]) -> FunctionType:
    copy = FunctionType(
        function.__code__,
        function.__globals__,
        function.__name__,
        function.__defaults__,
        function.__closure__,
    )
    copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
    copy.__kwdefaults__ = function.__kwdefaults__
    copy.__annotations__ = hints
    return copy


def _has_shape(hint: object) -> bool:
    if inspect.isclass(hint) and issubclass(hint, jaxtyping.AbstractArray):
        return True
    return any(_has_shape(inner) for inner in get_args(hint))
