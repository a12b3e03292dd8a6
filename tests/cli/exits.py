"""The command line, called in this process."""

from __future__ import annotations

import pytest

from asdfviz.cli import main


def exit_code(*arguments: str) -> int:
    """Run one command and return what a shell would see."""
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert isinstance(caught.value.code, int)
    return caught.value.code
