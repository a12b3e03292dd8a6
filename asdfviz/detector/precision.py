"""Whether a device computes in bfloat16 natively; where it does not, it is slower, not faster."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import torch

CPU_FLAGS = frozenset({"avx512_bf16", "amx_bf16"})


@cache
def has_bfloat16(device: str) -> bool:
    """Tell for a torch device such as "cpu" or "cuda:0"; False where it cannot be known."""
    kind = torch.device(device).type
    if kind == "cuda":
        return torch.cuda.is_bf16_supported()
    if kind != "cpu":
        return False
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="ascii", errors="replace")
    except OSError:
        return False
    flags = next((line for line in text.splitlines() if line.startswith("flags")), "")
    return not CPU_FLAGS.isdisjoint(flags.split())
