"""The commands as one tyro tree; importing it takes a second, so that only `main` does."""

from __future__ import annotations

from typing import Annotated

import tyro

from asdfviz.cli.ablate import Ablate
from asdfviz.cli.bench import Bench
from asdfviz.cli.data import Check, Export, ImportGbot
from asdfviz.cli.judge import Agree, Evaluate
from asdfviz.cli.learn import Train
from asdfviz.cli.learn_crops import TrainCrops
from asdfviz.cli.learn_masks import TrainMasks
from asdfviz.cli.learn_states import TrainStates
from asdfviz.cli.report import Report
from asdfviz.cli.run import Chosen, Methods, RunMethod, method_apart, print_method_help
from asdfviz.cli.synth import Synth
from asdfviz.cli.tables import Tables
from asdfviz.cli.view import View
from asdfviz.errors import InputError

Command = (
    Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[RunMethod, tyro.conf.subcommand("run")]
    | Annotated[Evaluate, tyro.conf.subcommand("evaluate")]
    | Annotated[Agree, tyro.conf.subcommand("agree")]
    | Annotated[Report, tyro.conf.subcommand("report")]
    | Annotated[Tables, tyro.conf.subcommand("tables")]
    | Annotated[Ablate, tyro.conf.subcommand("ablate")]
    | Annotated[Check, tyro.conf.subcommand("check")]
    | Annotated[Methods, tyro.conf.subcommand("methods")]
    | Annotated[Synth, tyro.conf.subcommand("synth")]
    | Annotated[Train, tyro.conf.subcommand("train")]
    | Annotated[TrainCrops, tyro.conf.subcommand("train-crops")]
    | Annotated[TrainStates, tyro.conf.subcommand("train-states")]
    | Annotated[TrainMasks, tyro.conf.subcommand("train-masks")]
    | Annotated[ImportGbot, tyro.conf.subcommand("import-gbot")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[Bench, tyro.conf.subcommand("bench")]
)


def obey(arguments: list[str]) -> int:
    """Do what one command line says.

    Returns:
        The exit code; only `check` has another than 0.

    Raises:
        InputError: it says what nobody knows.
    """
    is_run = arguments[:1] == ["run"]
    chosen: Chosen | None = None
    if is_run and not {"-h", "--help"} & set(arguments):
        arguments, chosen = method_apart(arguments)
    try:
        command, rest = tyro.cli(
            Command,  # pyright: ignore[reportArgumentType]  a union of annotated types is tyro's own idiom
            prog="asdfviz",
            description="Assembly states and 6D poses from RGB-D: run, inspect, correct, judge.",
            args=arguments,
            return_unknown_args=True,
            config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
        )
    except SystemExit as ended:
        if is_run and not ended.code:  # it was --help
            print_method_help(arguments)
        raise
    if rest:
        raise InputError(f"unknown arguments: {' '.join(rest)}; see asdfviz --help")
    if isinstance(command, Check):
        return command()
    if isinstance(command, RunMethod):
        command(chosen)
    else:
        command()
    return 0
