"""Opens the app: sequence, assembly, earlier runs and corrections, server. Library and command line call this."""

from __future__ import annotations

import getpass
import os
import stat
import threading
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asdfviz.annotate.corrected import run_of_seed
from asdfviz.annotate.identity import open_annotation
from asdfviz.annotate.paths import annotation_file, annotations_folder
from asdfviz.app.controller import Controller
from asdfviz.app.items import Message
from asdfviz.app.jobs import Background, start_check
from asdfviz.app.named_runs import load_named_run
from asdfviz.app.server import check_free, start_server, stop_server
from asdfviz.app.stopped import is_stopped
from asdfviz.app.truths import lost_base, unfinished_seed
from asdfviz.app.workspace import FIRST_METHOD, Workspace
from asdfviz.data.assembly import load_assembly
from asdfviz.data.atomic import make_folder
from asdfviz.data.resources import bundled_assemblies, models_folder
from asdfviz.data.result_csv import load_run_or_csv
from asdfviz.data.run_files import RUN, RUNS, load_run
from asdfviz.data.sequences import open_sequence
from asdfviz.errors import InputError, SequenceError
from asdfviz.methods.network import NetworkConfig, has_detector
from asdfviz.methods.registry import available_methods, find_method


@dataclass(frozen=True)
class ViewConfig:
    """What to open and where to serve it."""

    sequence: str = "sample"
    """Scene folder, or `sample` for the bundled one."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name; None for what the sequence names."""
    format: str | None = None
    """folder, bop, gbot, asdf or asdf-rgbd; None recognises it by content."""
    runs: tuple[Path, ...] = ()
    """Saved runs, or csv files of BOP or GBOT, to show beside those in the sequence's own runs folder."""
    annotations: Path | None = None
    """Where corrections are kept; None for annotations/ of the clone or of the working folder."""
    author: str | None = None
    """Who corrects; None for the login name."""
    host: str = "127.0.0.1"
    """Address to listen on; anything but this machine needs a token."""
    port: int = 8080
    """Port to listen on; 0 takes any free one."""
    token: str | None = None
    """Secret that opens the app when it listens beyond this machine; None makes one."""


class App:
    """A running app."""

    def __init__(self, server: Any, url: str, workspace: Workspace) -> None:
        self.url = url
        """Address to open, token included."""
        self.workspace = workspace
        self.background = Background(workspace)
        self._server = server
        self._tabs: dict[int, Controller] = {}
        self._leaving: list[Controller] = []
        """Whose page has gone, as long as they still write what waits."""
        self._lock = threading.Lock()
        self._closed = threading.Event()
        self._methods = available_methods()
        self._heard = 0
        self._has_begun = False
        server.on_client_connect(self._open_tab)
        server.on_client_disconnect(self._close_tab)

    def wait(self) -> None:
        """Serve until `close` is called or the process is interrupted."""
        while not self._closed.wait(1.0):
            pass

    def close(self) -> None:
        """Stop serving; every correction is on disk already."""
        if self._closed.is_set():
            return
        self._closed.set()
        self.background.close()
        with self._lock:
            tabs, leaving = tuple(self._tabs.values()), tuple(self._leaving)
        for tab in tabs:
            tab.close()
        for tab in (*tabs, *leaving):
            tab.wait(20.0)  # a slow one still reads and writes what is closed below
        stop_server(self._server)
        self.workspace.close()

    def tabs(self) -> tuple[Controller, ...]:
        """The browser tabs that are open."""
        with self._lock:
            return tuple(self._tabs.values())

    def drop_connections(self) -> None:
        """Close every connection; pages connect again by themselves."""
        self._server._websock_server.disconnect_all_clients()

    def _open_tab(self, client: Any) -> None:
        # What was said while the app opened is for the first tab.
        heard, self._heard = self._heard, len(self.workspace.messages)
        tab = Controller(
            client,
            self.workspace,
            self.background,
            self._methods,
            heard=heard,
            on_shown=self._begin,
        )
        with self._lock:
            self._tabs[client.client_id] = tab
        tab.start()

    def _begin(self) -> None:
        """Start what works by itself, once a picture is shown: before, it would only delay that."""
        with self._lock:
            has_begun, self._has_begun = self._has_begun, True
        if has_begun:
            return
        start_check(self.workspace)
        workspace = self.workspace
        is_wanted = not workspace.runs and not is_stopped(workspace.store, FIRST_METHOD)
        if is_wanted and has_detector(NetworkConfig(), workspace.assembly):
            self.background.run(find_method(FIRST_METHOD))

    def _close_tab(self, client: Any) -> None:
        with self._lock:
            tab = self._tabs.pop(client.client_id, None)
            if tab is None:
                return
            self._leaving = [one for one in self._leaving if not one.has_ended] + [tab]
        tab.close()


def open_app(config: ViewConfig) -> App:
    """Open a sequence in the app and serve it.

    Raises:
        InputError: the sequence, the assembly, a run, the annotation or the port cannot be used.
    """
    check_free(config.host, config.port)  # no annotation file is made for what cannot be served
    workspace = open_workspace(config)
    try:
        server, url = start_server(config.host, config.port, token=config.token)
    except InputError:
        workspace.close()
        raise
    _configure(server)
    return App(server, url, workspace)


def open_workspace(config: ViewConfig) -> Workspace:
    """Gather what the app shares between its tabs.

    Raises:
        InputError: something that was named cannot be used; the message says what would be right.
    """
    given = None if config.assembly is None else load_assembly(config.assembly)
    sequence = open_sequence(config.sequence, assembly=given, format=config.format)
    assembly = sequence.assembly
    if assembly is None:
        known = ", ".join(bundled_assemblies()) or "none"
        raise SequenceError(
            f"{sequence.path} does not say what is being assembled: "
            f"give --assembly PATH or a bundled name ({known})"
        )
    named = [
        (run.resolve(), load_named_run(run, sequence=sequence, assembly=assembly))
        for run in config.runs
    ]
    # Truth is read here: where it does not fit the assembly, no annotation file is made for that.
    sequence.truth(0)
    folder = annotations_folder() if config.annotations is None else config.annotations
    make_folder(folder)
    store = open_annotation(
        sequence, assembly, folder=folder, author=config.author or _login_name()
    )
    name = store.path.stem
    scene = Path(sequence.path)
    runs = scene / RUNS if _is_ours_to_write(scene) else folder / RUNS / name
    runs = runs.resolve()
    workspace = Workspace(
        sequence,
        assembly,
        store=store,
        runs_folder=runs,
        export_folder=folder / "exports" / name,
    )
    first = annotation_file(sequence.name, folder=folder)
    if store.path != first:
        said = f"{first.name} holds those of another sequence called '{sequence.name}'."
        workspace.say(Message("Corrections go to " + store.path.name, said))
    for home, run in named:
        workspace.put_run(run, str(home), folder=home)
    _load_earlier_runs(workspace, (scene / RUNS, runs))
    _load_run_of_seed(workspace)
    return workspace


def _load_earlier_runs(workspace: Workspace, folders: tuple[Path, ...]) -> None:
    """Load what was run before; a run that no longer fits is told, not fatal."""
    files = {file for folder in folders for file in folder.resolve().glob(f"*/{RUN}")}
    for file in sorted(files, key=lambda file: (file.stat().st_mtime, str(file))):
        folder = file.parent
        if workspace.run(str(folder)) is not None:
            continue
        try:
            run = load_run(folder, assembly=workspace.assembly)
        except InputError as error:
            workspace.say(Message("A run was left out", str(error), is_problem=True))
            continue
        workspace.put_run(run, str(folder), folder=folder)


def _load_run_of_seed(workspace: Workspace) -> None:
    """Load the run that corrections started from, wherever it lies; one that is lost is told."""
    seed, why = workspace.store.seed(), ""
    is_lost = workspace.base_of_seed() is None and unfinished_seed(workspace) is None
    if seed.run is not None and is_lost:
        sequence = workspace.frames.source
        folder = run_of_seed(seed.run, sequence)
        try:
            run = load_run_or_csv(folder, sequence=sequence, assembly=workspace.assembly)
            workspace.put_run(run, str(folder), folder=folder)
        except InputError as error:
            why = f" ({error})"
    lost = lost_base(workspace)
    if lost is not None:
        workspace.say(Message("Not what was corrected", lost + why, is_problem=True))


def _is_ours_to_write(scene: Path) -> bool:
    """Runs go beside the images, but not into the bundled models or a folder that is read-only."""
    # The bits are asked as well: root may write everywhere, but a folder marked read-only is meant so.
    is_open = bool(scene.stat().st_mode & stat.S_IWUSR) and os.access(scene, os.W_OK)
    return is_open and not scene.is_relative_to(models_folder())


def _login_name() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "anonymous"


def _light(scene: Any) -> None:
    """From the camera, a little from above, and from all around: a picture of surroundings and shadow
    maps, which nothing here needs, take a computer without a GPU most of the time it draws."""
    scene.configure_default_lights(False)
    scene.configure_environment_map(None)
    scene.add_light_hemisphere(
        "/lights/around", sky_color=(255, 255, 255), ground_color=(150, 160, 175), intensity=0.9
    )
    scene.add_light_directional(
        "/lights/camera", position=(-0.5, -0.8, -1.0), intensity=1.5, cast_shadow=False
    )


def _configure(server: Any) -> None:
    # A browser tab that closes while its thread draws is no news to anybody.
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")
    server.scene.set_up_direction("-y")
    server.scene.world_axes.visible = False
    _light(server.scene)
    server.gui.configure_theme(
        dark_mode=True,
        show_logo=False,
        show_share_button=False,
        control_width="large",
        brand_color=(86, 180, 233),
    )
    server.gui.main_panel.dock_right()
    server.gui.main_panel.set_width(380)
