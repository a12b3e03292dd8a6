"""Finds methods: built in, from entry points, or in a file. A broken plug-in breaks nothing else."""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import importlib.util
import sys
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import cast

from asdfviz.errors import AsdfvizError, MethodError
from asdfviz.methods.spec import BrokenMethod, Method, MethodSpec

GROUP = "asdfviz.methods"
BUILT_IN = {
    "yolov8pose": "asdfviz.methods.yolov8pose:SPEC",
    "yolov8pose_state": "asdfviz.methods.yolov8pose_state:SPEC",
    "yolov8pose_icp": "asdfviz.methods.yolov8pose_icp:SPEC",
    "asdf_seg": "asdfviz.methods.asdf_seg:SPEC",
    "asdf": "asdfviz.methods.asdf:SPEC",
    "asdf_plus": "asdfviz.methods.asdf_plus:SPEC",
    "asdf_track": "asdfviz.methods.asdf_track:SPEC",
    "srt3d": "asdfviz.methods.srt3d:SPEC",
    "icg": "asdfviz.methods.icg:SPEC",
    "icg_srt3d": "asdfviz.methods.icg_srt3d:SPEC",
    "gbot": "asdfviz.methods.gbot:SPEC",
    "gbot_reinit": "asdfviz.methods.gbot_reinit:SPEC",
}
"""Listed by the package's own entry points too; here, so that a clone on the path is enough."""


def available_methods() -> dict[str, MethodSpec | BrokenMethod]:
    """Every method by name, built-in ones first; one that cannot be loaded says why."""
    found = {name: _spec_or_reason(EntryPoint(name, v, GROUP)) for name, v in BUILT_IN.items()}
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name):
        if entry.name not in found:
            found[entry.name] = _spec_or_reason(entry)
    return found


def find_method(name: str) -> MethodSpec:
    """Return the method of that name, or the one that `file.py` (its SPEC) or `file.py:NAME` points at.

    Raises:
        MethodError: there is none of that name, or it is broken; with the names there are.
    """
    file, _, variable = (name, "", "") if name.endswith(".py") else name.rpartition(":")
    if file.endswith(".py"):
        return _spec_in_file(Path(file).expanduser().resolve(), variable or "SPEC")
    methods = available_methods()
    spec = methods.get(name)
    if spec is None:
        raise MethodError(
            f"no method '{name}'; use {', '.join(methods)}, or file.py:SPEC for one of your own"
        )
    if isinstance(spec, BrokenMethod):
        raise MethodError(f"method '{name}' is broken: {spec.reason}")
    return spec


def build_method(spec: MethodSpec, config: object | None = None) -> Method:
    """Import the factory and make the method with its config, or with the default one.

    Raises:
        MethodError: the config is of another class, or the factory cannot be imported.
    """
    config = spec.config() if config is None else config
    if not isinstance(config, spec.config):
        raise MethodError(
            f"method '{spec.name}' takes a {spec.config.__name__}, not a {type(config).__name__}"
        )
    module, _, attribute = spec.factory.partition(":")
    try:
        factory = getattr(importlib.import_module(module), attribute)
        return cast(Method, factory(config))
    except AsdfvizError:
        raise
    except (Exception, SystemExit) as error:
        file = getattr(sys.modules.get(module), "__file__", None) or module
        raise MethodError(
            f"method '{spec.name}': {attribute} of {file} cannot be made: {_reason(error)}"
        ) from error


def _spec_or_reason(entry: EntryPoint) -> MethodSpec | BrokenMethod:
    try:
        return _load_entry(entry)
    except MethodError as error:
        return BrokenMethod(entry.name, str(error))


def _load_entry(entry: EntryPoint) -> MethodSpec:
    try:
        loaded = entry.load()
    except (Exception, SystemExit) as error:
        raise MethodError(f"{entry.value} cannot be imported: {_reason(error)}") from error
    return _checked(loaded, entry.value)


def _spec_in_file(file: Path, variable: str) -> MethodSpec:
    module = _import_file(file)
    if not hasattr(module, variable):
        raise MethodError(f"{file} has no '{variable}'; it needs {variable} = MethodSpec(...)")
    spec = _checked(getattr(module, variable), f"{file}:{variable}")
    owner, _, attribute = spec.factory.partition(":")
    if owner == file.stem:  # the file's own name is what its author would write
        return dataclasses.replace(spec, factory=f"{module.__name__}:{attribute}")
    return spec


def _import_file(file: Path) -> ModuleType:
    if not file.is_file():
        raise MethodError(f"no file {file}; --method takes a method's name or file.py:SPEC")
    # A name of its own for every path: two files of one name must not replace each other.
    name = f"asdfviz_method_{file.stem}_{hashlib.sha256(str(file).encode()).hexdigest()[:8]}"
    description = importlib.util.spec_from_file_location(name, file)
    if description is None or description.loader is None:
        raise MethodError(f"{file} is no Python file")
    module = importlib.util.module_from_spec(description)
    sys.modules[name] = module  # before it runs: its dataclasses and factory look themselves up
    try:
        description.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise MethodError(f"{file} cannot be imported: {_reason(error)}") from error
    return module


def _checked(loaded: object, where: str) -> MethodSpec:
    if not isinstance(loaded, MethodSpec):
        raise MethodError(f"{where} is a {type(loaded).__name__}, not a MethodSpec")
    if not dataclasses.is_dataclass(loaded.config):
        raise MethodError(f"{where}: its config must be a dataclass with defaults")
    bare = [f.name for f in dataclasses.fields(loaded.config) if f.init and not _has_default(f)]
    if bare:
        raise MethodError(f"{where}: its config needs a default for {', '.join(bare)}")
    return loaded


def _has_default(field: dataclasses.Field[object]) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def _reason(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}"
