"""`asdfviz view`: the browser app."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class View:
    """Open the browser app on a sequence.

    Example: asdfviz view sample --port 8123
    """

    sequence: Annotated[str, tyro.conf.Positional] = "sample"
    """Scene folder, or `sample` for the bundled one."""
    assembly: str | None = None
    """assembly.yaml, its folder, or a bundled name. Default: what the sequence names."""
    format: str | None = None
    """folder, bop, gbot, asdf or asdf-rgbd. Default: recognised by content."""
    runs: tuple[Path, ...] = ()
    """Saved runs, or csv files of BOP or GBOT, to show beside those in the sequence's own runs folder."""
    annotations: Path | None = None
    """Where corrections are kept. Default: annotations/ of the clone, or of the working folder."""
    author: str | None = None
    """Who corrects. Default: the login name."""
    host: str = "127.0.0.1"
    """Address to listen on; anything but this machine needs a token."""
    port: int = 8080
    """Port to listen on; 0 takes any free one."""
    token: str | None = None
    """Secret that opens the app when it listens beyond this machine."""

    def __call__(self) -> None:
        """Open the app, print its address and serve until Ctrl+C."""
        from asdfviz.app.main import ViewConfig, open_app
        from asdfviz.app.server import outside_url

        app = open_app(ViewConfig(**vars(self)))
        print(f"asdfviz is at {app.url}  (Ctrl+C ends it)", flush=True)
        if outside := outside_url(app.url, self.host):
            print(f"other machines open {outside}", flush=True)
        try:
            app.wait()
        finally:
            app.close()
