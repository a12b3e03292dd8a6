"""A method's options: found with their hints, read back from text, told apart from the defaults."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

import pytest
from tiny_sequence import make_run

from asdfviz.app.options import config_from, differences, option_groups
from asdfviz.data.run_files import load_run, save_run
from asdfviz.datatypes import Assembly
from asdfviz.errors import MethodError
from asdfviz.methods.asdf_config import AsdfConfig
from asdfviz.methods.asdf_plus_config import AsdfPlusConfig
from asdfviz.methods.asdf_track_config import AsdfTrackConfig


@dataclass(frozen=True)
class Inner:
    size: int = 640
    """Longer side,
    pixels."""
    share: float = 0.5
    """A share."""
    file: Path | None = None


@dataclass(frozen=True)
class Outer:
    network: Inner = field(default_factory=lambda: Inner(share=0.25))
    """The network."""
    solver: Literal["fast", "robust"] = "robust"
    """Which one."""
    enabled: bool = True
    corners: tuple[int, ...] = (1, 2)
    first: Literal["boxes", "crops"] | None = None
    """Default: what there are weights for."""


def test_every_plain_field_is_an_option_with_its_docstring() -> None:
    own, network = option_groups(Outer)
    assert [(o.name, o.kind, o.default) for o in own.options] == [
        ("solver", "choice", "robust"),
        ("enabled", "switch", "True"),
        ("first", "choice", ""),
    ]
    assert own.options[0].choices == ("fast", "robust")
    assert own.options[2].choices == ("", "boxes", "crops")
    assert (network.name, network.hint) == ("network", "The network.")
    assert [(o.name, o.kind, o.default, o.hint) for o in network.options] == [
        ("network.size", "whole", "640", "Longer side, pixels."),
        ("network.share", "number", "0.25", "A share."),
        ("network.file", "text", "", ""),
    ]


def test_text_becomes_a_config() -> None:
    given = {
        "network.size": " 320 ",
        "network.file": "w.pt",
        "solver": "fast",
        "enabled": "False",
    }
    made = config_from(Outer, given)
    inner = Inner(size=320, share=0.25, file=Path("w.pt"))
    assert made == Outer(network=inner, solver="fast", enabled=False)
    assert config_from(Outer, {}) == Outer()
    assert config_from(Outer, {"network.file": "", "first": ""}) == Outer()
    assert config_from(Outer, {"first": "crops"}) == Outer(first="crops")


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"network.size": "6.5"}, "network.size is '6.5': give a whole number"),
        ({"network.share": "nan"}, "network.share is 'nan': give a number"),
        ({"network.share": ""}, "give a number"),
        ({"solver": "slow"}, "choose fast or robust"),
        ({"network.depth": "3"}, "no option 'network.depth'; options: solver"),
    ],
)
def test_what_does_not_fit_is_said(given: dict[str, str], said: str) -> None:
    with pytest.raises(MethodError, match=said):
        config_from(Outer, given)


def test_runs_tell_what_was_changed() -> None:
    saved = asdict(replace(Outer(), solver="fast"))
    saved["network"]["size"] = 320
    assert differences(Outer(), saved) == {"network.size": "320", "solver": "fast"}
    assert differences(Outer(), asdict(Outer())) == {}


def test_a_run_with_the_defaults_tells_of_no_change_once_it_was_saved(
    tmp_path: Path, clamp: Assembly
) -> None:
    run = replace(make_run(clamp), config=asdict(AsdfPlusConfig()))
    save_run(run, tmp_path / "run")
    saved = load_run(tmp_path / "run").config
    assert differences(AsdfPlusConfig(), saved) == {}


def test_all_options_of_asdf_have_hints_and_read_back() -> None:
    options = [option for group in option_groups(AsdfConfig) for option in group.options]
    assert {"detector.weights", "detector.image_size", "detector.confidence"} <= {
        option.name for option in options
    }
    assert all(option.hint for option in options)
    assert config_from(AsdfConfig, {o.name: o.default for o in options}) == AsdfConfig()


@pytest.mark.parametrize("config", [AsdfPlusConfig, AsdfTrackConfig])
def test_what_a_method_does_not_ask_is_no_option_of_it(config: type) -> None:
    """Their state is followed and their parts are joined otherwise than in asdf."""
    options = [option for group in option_groups(config) for option in group.options]
    names = {option.name for option in options}
    assert {name.partition(".")[0] for name in names}.isdisjoint({"fusion", "group"})
    assert {"smoothing.stay", "group_fit.enabled"} <= names
    assert config_from(config, {o.name: o.default for o in options}) == config()
    with pytest.raises(MethodError, match=r"no option 'fusion\.w_dl'"):
        config_from(config, {"fusion.w_dl": "0.3"})
