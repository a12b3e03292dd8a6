"""Cuts a file into pieces that any channel takes, and joins them again."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from asdfviz.data.atomic import write_bytes, write_text
from asdfviz.errors import InputError

PIECE_BYTES = 15 * 2**20
"""Largest piece."""


def cut_file(file: Path, folder: Path) -> list[Path]:
    """Write NAME.000, NAME.001, ... and NAME.json, which lists them, into a folder."""
    content = file.read_bytes()
    count = max(1, -(-len(content) // PIECE_BYTES))
    pieces = [folder / f"{file.name}.{i:03d}" for i in range(count)]
    for place, piece in enumerate(pieces):
        write_bytes(piece, content[place * PIECE_BYTES : (place + 1) * PIECE_BYTES])
    about = {"pieces": [p.name for p in pieces], "sha256": hashlib.sha256(content).hexdigest()}
    write_text(folder / f"{file.name}.json", json.dumps(about) + "\n")
    return pieces


def join_file(name: str, folder: Path, target: Path) -> None:
    """Write a file from its pieces.

    Raises:
        InputError: a piece is missing, or the whole is not what was cut.
    """
    list_file = folder / f"{name}.json"
    if not list_file.is_file():
        raise InputError(f"{folder} holds no {name}.json: name the folder that `cut_file` wrote")
    about = json.loads(list_file.read_text(encoding="utf-8"))
    pieces = [folder / str(piece) for piece in about["pieces"]]
    missing = [piece.name for piece in pieces if not piece.is_file()]
    if missing:
        raise InputError(f"{folder} lacks {', '.join(missing)}: bring all pieces of {name}")
    content = b"".join(piece.read_bytes() for piece in pieces)
    if hashlib.sha256(content).hexdigest() != about["sha256"]:
        raise InputError(f"the pieces of {name} in {folder} do not belong together")
    write_bytes(target, content)
