"""The command line: one tyro tree; each command is a frozen config, one call, and printing."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from asdfviz.data.interrupts import interrupts_after_imports
from asdfviz.errors import AsdfvizError, Stopped

BAD_INPUT = 2
STOPPED = 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command.

    Exits 0, 2 for bad input (also where `check` met images that cannot be read) or a machine that lacks
    something, 130 when stopped.
    """
    sys.exit(_exit_code(sys.argv[1:] if arguments is None else list(arguments)))


def _exit_code(arguments: list[str]) -> int:
    code = 0
    # A terminal of ASCII alone, or of another code page, is shown "\xb0" for "°" rather than a traceback.
    reconfigure = getattr(sys.stdout, "reconfigure", None)
    if reconfigure is not None:
        reconfigure(errors="backslashreplace")
    try:
        with interrupts_after_imports():
            from asdfviz.cli.commands import obey  # here, as Ctrl+C may come meanwhile

            code = obey(arguments)
            sys.stdout.flush()
    except (KeyboardInterrupt, Stopped) as stopped:
        print(f"stopped{f': {stopped}' if str(stopped) else ''}", file=sys.stderr)
        return STOPPED
    except BrokenPipeError:
        # The reader (head, less) has gone: silence the interpreter's own flush at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except (AsdfvizError, OSError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    return code
