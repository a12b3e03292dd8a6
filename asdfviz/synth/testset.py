"""The test sets that all tables stand on: the paper's Table 1 and GBOT's four conditions.

    FOLDER/<assembly>/testset.json   seeds, commands and versions
    FOLDER/<assembly>/table1/        one sequence through all states, as long as the paper's
    FOLDER/<assembly>/normal/  dynamic/  hand/  blur/
    FOLDER/<assembly>/<first>_plain/ the first of them, drawn by another renderer

Their seeds, `TEST_SEEDS`, are theirs alone: nothing may be trained on them, and `generate_images`
refuses them.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeAlias

from asdfviz import __version__
from asdfviz.data.atomic import write_text
from asdfviz.data.hashes import assembly_sha256
from asdfviz.data.scene_objects import SCENE_GT
from asdfviz.datatypes import Assembly
from asdfviz.errors import InputError
from asdfviz.synth.assets import load_assets
from asdfviz.synth.bop_writer import SceneFolder, require_equal, require_size
from asdfviz.synth.images import TEST_SEEDS
from asdfviz.synth.rerender import rerender
from asdfviz.synth.sequences import (
    SequenceConfig,
    condition_config,
    generate_sequence,
    plan_sequence,
    scenes_of,
)
from asdfviz.synth.workers import Crew, Piece, Stop, do_all

Kind: TypeAlias = Literal["table1", "gbot"]

SETS: Mapping[Kind, tuple[str, ...]] = {
    "table1": ("table1",),
    "gbot": ("normal", "dynamic", "hand", "blur"),
}
PAPER_FRAMES: Mapping[int, int] = {3: 66, 5: 111, 8: 191, 10: 231}
"""Table 1: frames by number of states (CornerClamp, GearedCaliper, NanoVise, ScrewClamp)."""
FRAMES_A_STATE = 23
"""For assemblies of another size: the paper's mean."""
PLAIN = "_plain"
TESTSET = "testset.json"
_SEEDS_APART = 10
"""Seeds of one test set; more than it has sequences."""


@dataclass(frozen=True, slots=True)
class SetsConfig:
    """Which sets, and how large."""

    only: Kind | None = None
    """None for both kinds."""
    seed: int = 0
    """0 to 99999; the sequences' own seeds follow from it."""
    width: int = 1280
    """Pixels."""
    height: int = 720
    """Pixels."""
    frames_per_state: int | None = None
    """None for the paper's numbers of frames."""
    masks: bool = False
    """Write BOP's masks too."""

    @property
    def names(self) -> tuple[str, ...]:
        """The sequences to make, by name."""
        kinds: tuple[Kind, ...] = ("table1", "gbot") if self.only is None else (self.only,)
        return tuple(name for kind in kinds for name in SETS[kind])

    def seed_of(self, name: str) -> int:
        """The seed of one sequence, the same whatever else is made."""
        every = [name for names in SETS.values() for name in names]
        return TEST_SEEDS.start + self.seed * _SEEDS_APART + every.index(name)


def generate_testset(
    assembly: Assembly,
    *,
    folder: Path,
    config: SetsConfig | None = None,
    command: str = "",
    progress: Callable[[int, int], None] | None = None,
    stop: Stop | None = None,
    device: str = "cpu",
    crew: Crew | None = None,
) -> Path | None:
    """Write the test sets of an assembly; what is there already stays.

    Args:
        assembly: parts and states.
        folder: receives <assembly>/<set>/, BOP scene folders.
        config: which sets, and how large.
        command: what was typed, for testset.json.
        progress: called with frames done and in all.
        stop: asked before every frame; true ends the job, which can be taken up later.
        device: where torch renders.
        crew: other processes that share the sequences.

    Returns:
        The folder of this assembly, or None when stopped.

    Raises:
        InputError: seed, size or number of frames is impossible, or a folder holds something else.
        RenderError: OpenGL, which draws the plain set, is missing.
    """
    chosen = config or SetsConfig()
    _check(chosen, crew)
    home = folder / assembly.name
    _begin(home, assembly, chosen)
    work = SequenceWork(assembly, home, chosen, device)

    def tell(plain: int) -> None:
        if progress is not None:
            progress(*work.frames_done(plain))

    missing = [k for k, name in enumerate(chosen.names) if not SceneFolder(home / name).is_finished]
    if not do_all(work, missing, crew=crew, tick=lambda _: tell(0), stop=stop):
        return None
    for name in chosen.names:
        _note(home, chosen, name, command)
    first = chosen.names[0]
    if not work.draw_plain(first, tell, stop):
        return None
    _note(home, chosen, first + PLAIN, command)
    return home


def _check(config: SetsConfig, crew: Crew | None) -> None:
    seeds = len(TEST_SEEDS) // _SEEDS_APART
    if not 0 <= config.seed < seeds:
        raise InputError(f"seed {config.seed}: test sets take 0 to {seeds - 1}")
    if config.frames_per_state is not None and config.frames_per_state < 1:
        raise InputError(f"{config.frames_per_state} frames a state: use 1 or more")
    require_size(config.width, config.height)
    (crew or Crew()).check()


@dataclass(frozen=True, slots=True, eq=False)
class SequenceWork:
    """The sequences of one test set, for `workers.do_all`; a piece is one sequence."""

    assembly: Assembly
    home: Path
    config: SetsConfig
    device: str
    token: str = field(default_factory=lambda: secrets.token_hex(8))

    def config_of(self, name: str) -> SequenceConfig:
        """How a sequence is played and recorded: Table 1 knows no errors, the others one each."""
        size = {"width": self.config.width, "height": self.config.height}
        each = self.config.frames_per_state
        if name != "table1":
            return condition_config(name, frames_per_state=each, **size)
        frames = self._paper_frames() if each is None else None
        return condition_config("table", error=False, frames=frames, frames_per_state=each, **size)

    def frames_done(self, plain: int) -> tuple[int, int]:
        """Frames that are there, `plain` ones among them, and about how many there will be."""
        expected = self._paper_frames()
        if self.config.frames_per_state is not None:
            expected = self.config.frames_per_state * len(self.assembly.steps)
        done, total = plain, 0
        for place, name in enumerate(self.config.names):
            folder = SceneFolder(self.home / name)
            there = folder.frames_done
            whole = there if folder.is_finished else max(expected, there)
            done += there
            total += 2 * whole if place == 0 else whole
        return done, total

    def _paper_frames(self) -> int:
        states = len(self.assembly.steps)
        return PAPER_FRAMES.get(states, FRAMES_A_STATE * states)

    def open(self) -> Piece:
        """Nothing to prepare: every sequence loads what it needs."""
        return self._write

    def _write(self, number: int, stop: Stop) -> None:
        name = self.config.names[number]
        generate_sequence(
            self.assembly,
            seed=self.config.seed_of(name),
            folder=self.home / name,
            config=self.config_of(name),
            stop=stop,
            device=self.device,
            masks=self.config.masks,
        )

    def draw_plain(self, name: str, progress: Callable[[int], None], stop: Stop | None) -> bool:
        """Draw a finished sequence again in plain colours; returns whether it is complete."""
        target = self.home / (name + PLAIN)
        if (target / SCENE_GT).is_file():
            return True
        assets = load_assets(self.assembly)
        config, seed = self.config_of(name), self.config.seed_of(name)
        play = plan_sequence(assets, seed=seed, config=config)
        scenes = [s.scene for s in scenes_of(play, assets, seed=seed, config=config)]
        return rerender(
            self.home / name,
            target,
            scenes=scenes,
            assets=assets,
            progress=lambda done, _: progress(done),
            stop=stop,
        )


def _begin(home: Path, assembly: Assembly, config: SetsConfig) -> None:
    """Note what the folder is for, or see that it was begun for the same."""
    file = home / TESTSET
    about: dict[str, Any] = {
        "assembly": assembly.name,
        "assembly_sha256": assembly_sha256(assembly),
        "seed": config.seed,
        "width": config.width,
        "height": config.height,
        "frames_per_state": config.frames_per_state,
        "masks": config.masks,
    }
    if not file.is_file():
        strangers = [p.name for p in home.iterdir()] if home.is_dir() else []
        if strangers:
            raise InputError(
                f"{home} holds something else ({', '.join(strangers[:4])}): take another folder"
            )
        write_text(file, json.dumps({**about, "sets": {}}, indent=1) + "\n")
        return
    require_equal(file, about)


def _note(home: Path, config: SetsConfig, name: str, command: str) -> None:
    """Add a finished set to testset.json; one that is there stays as it was written."""
    file = home / TESTSET
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    source = name.removesuffix(PLAIN)
    entry = {
        "seed": config.seed_of(source),
        "frames": SceneFolder(home / name).frames_done,
        "renderer": "pyrender" if name.endswith(PLAIN) else "asdfviz",
        "version": __version__,
        "command": command,
    }
    content["sets"] = {**content["sets"], name: content["sets"].get(name, entry)}
    write_text(file, json.dumps(content, indent=1) + "\n")
