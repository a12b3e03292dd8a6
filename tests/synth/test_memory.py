"""Freed memory stays with the process that draws."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

FAULTS = """
import resource
import sys
import numpy as np
from asdfviz.datatypes import Mesh
from asdfviz.synth.mesh_bank import MeshBank

if sys.argv[1] == "drawing":
    MeshBank.of([Mesh(np.eye(3), np.array([[0, 1, 2]]))])
np.ones(8_000_000)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    np.ones(8_000_000)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""
"""Prints how many pages come from the kernel for ten arrays of 64 MB, each freed at once."""


def pages(what: str) -> int:
    told = subprocess.run(
        [sys.executable, "-c", FAULTS, what], capture_output=True, text=True, check=True
    )
    return int(told.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library than glibc")
def test_large_arrays_come_from_what_was_freed_while_drawing() -> None:
    assert pages("drawing") < 0.1 * pages("nothing")
