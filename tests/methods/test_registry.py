from __future__ import annotations

import tomllib
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import pytest

from asdfviz.errors import MethodError
from asdfviz.methods import registry
from asdfviz.methods.asdf import Asdf
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.registry import (
    BUILT_IN,
    GROUP,
    available_methods,
    build_method,
    find_method,
)
from asdfviz.methods.spec import BrokenMethod, MethodSpec

REPOSITORY = Path(__file__).resolve().parents[2]
PLUGIN = """
from __future__ import annotations

from dataclasses import dataclass

from asdfviz.datatypes import FramePrediction
from asdfviz.methods.spec import MethodSpec


@dataclass(frozen=True)
class Config:
    gain: float = 2.0


class Mine:
    def __init__(self, config: Config) -> None:
        self.gain = config.gain

    def reset(self, assembly, camera, initial) -> None:
        pass

    def step(self, frame) -> FramePrediction:
        return FramePrediction(frame.index, {}, None)


SPEC = MethodSpec("mine", "Says nothing.", Config, "FACTORY")
"""


@pytest.fixture
def plugin(tmp_path: Path) -> Path:
    file = tmp_path / "mine.py"
    file.write_text(PLUGIN.replace('"FACTORY"', 'f"{__name__}:Mine"'))
    return file


def with_entry_points(monkeypatch: pytest.MonkeyPatch, **values: str) -> None:
    entries = EntryPoints(EntryPoint(n, v, registry.GROUP) for n, v in values.items())
    monkeypatch.setattr(registry, "entry_points", lambda group: entries)


def test_the_built_in_methods_are_there() -> None:
    methods = available_methods()
    assert {"yolov8pose", "asdf"} <= set(methods)
    for name in ("yolov8pose", "asdf"):
        spec = methods[name]
        assert isinstance(spec, MethodSpec)
        assert spec.name == name
        assert spec.initial == "none"
        assert spec.summary


def test_a_built_in_method_is_found_and_made() -> None:
    spec = find_method("asdf")
    assert isinstance(build_method(spec), Asdf)
    assert isinstance(build_method(spec, AsdfConfig()), Asdf)


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(MethodError, match="asdf"):
        find_method("sdfa")


@pytest.mark.parametrize("factory", ['f"{__name__}:Mine"', '"mine:Mine"'])
def test_a_method_in_a_file(tmp_path: Path, factory: str) -> None:
    file = tmp_path / "mine.py"
    file.write_text(PLUGIN.replace('"FACTORY"', factory))
    spec = find_method(f"{file}:SPEC")
    assert spec.name == find_method(str(file)).name == "mine"
    method = build_method(spec, spec.config(gain=5.0))
    assert getattr(method, "gain") == 5.0  # noqa: B009 - not part of the protocol


def test_two_files_of_one_name_do_not_mix(plugin: Path, tmp_path: Path) -> None:
    other = tmp_path / "other" / "mine.py"
    other.parent.mkdir()
    other.write_text(plugin.read_text().replace('"mine"', '"theirs"'))
    first, second = find_method(f"{plugin}:SPEC"), find_method(f"{other}:SPEC")
    assert (first.name, second.name) == ("mine", "theirs")
    assert type(build_method(first)) is not type(build_method(second))


@pytest.mark.parametrize(
    ("content", "variable", "message"),
    [
        (None, "SPEC", "no file"),
        ("SPEC = 3\n", "SPEC", "not a MethodSpec"),
        (PLUGIN, "SPEK", "no 'SPEK'"),
        (
            PLUGIN.replace("gain: float = 2.0", "gain: float"),
            "SPEC",
            "its config needs a default for gain",
        ),
        ("import there_is_no_such_module\n", "SPEC", "there_is_no_such_module"),
        ("raise SystemExit(3)\n", "SPEC", "SystemExit"),
        ("SPEC = (\n", "SPEC", "SyntaxError"),
    ],
)
def test_a_file_that_cannot_be_used_says_why(
    tmp_path: Path, content: str | None, variable: str, message: str
) -> None:
    file = tmp_path / "mine.py"
    if content is not None:
        file.write_text(content)
    with pytest.raises(MethodError, match=message):
        find_method(f"{file}:{variable}")


def test_a_broken_plug_in_is_listed_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    with_entry_points(
        monkeypatch,
        missing="there_is_no_such_module:SPEC",
        wrong="asdfviz.methods.asdf:Asdf",
        also_asdf="asdfviz.methods.asdf:SPEC",
    )
    methods = available_methods()
    assert isinstance(methods["asdf"], MethodSpec)
    assert isinstance(methods["also_asdf"], MethodSpec)
    missing, wrong = methods["missing"], methods["wrong"]
    assert isinstance(missing, BrokenMethod)
    assert isinstance(wrong, BrokenMethod)
    assert "there_is_no_such_module" in missing.reason
    assert "not a MethodSpec" in wrong.reason
    with pytest.raises(MethodError, match="broken"):
        find_method("missing")


def test_no_plug_in_replaces_a_built_in_method(monkeypatch: pytest.MonkeyPatch) -> None:
    with_entry_points(monkeypatch, asdf="there_is_no_such_module:SPEC")
    assert isinstance(available_methods()["asdf"], MethodSpec)


def test_a_config_of_another_class_is_refused(plugin: Path) -> None:
    with pytest.raises(MethodError, match="takes a Config, not a AsdfConfig"):
        build_method(find_method(f"{plugin}:SPEC"), AsdfConfig())


@pytest.mark.parametrize("factory", ['"there_is_no_such_module:Mine"', 'f"{__name__}:Yours"'])
def test_a_factory_that_cannot_be_made_says_so(tmp_path: Path, factory: str) -> None:
    file = tmp_path / "mine.py"
    file.write_text(PLUGIN.replace('"FACTORY"', factory))
    with pytest.raises(MethodError, match="cannot be made"):
        build_method(find_method(f"{file}:SPEC"))


def test_a_file_without_a_name_behind_it_means_spec(plugin: Path) -> None:
    assert find_method(f"{plugin}:").name == "mine"


@pytest.mark.parametrize("fault", ["raise ValueError('no luck')", "raise SystemExit(3)"])
def test_a_method_that_fails_when_made_names_its_file(tmp_path: Path, fault: str) -> None:
    file = tmp_path / "mine.py"
    content = PLUGIN.replace("self.gain = config.gain", fault)
    file.write_text(content.replace('"FACTORY"', '"mine:Mine"'))
    with pytest.raises(MethodError, match=r"Mine of .*mine\.py cannot be made: (Val|Sys)"):
        build_method(find_method(f"{file}:SPEC"))


def test_the_package_lists_what_is_built_in() -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    assert project["entry-points"][GROUP] == BUILT_IN
