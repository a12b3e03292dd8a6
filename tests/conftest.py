"""Shape checks for the whole package, and the data folder that only some machines have."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

# Modules imported from here on check their jaxtyping annotations at every call.
install_import_hook("asdfviz", "beartype.beartype")

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder with the paper's parts, real frames and reference outputs."""
    folder = Path(os.environ.get("ASDFVIZ_SHARED", REPOSITORY.parent / "shared"))
    if not (folder / "data").is_dir():
        pytest.skip(f"no shared data folder at {folder} (set ASDFVIZ_SHARED)")
    return folder
