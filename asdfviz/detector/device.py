"""Refuses a torch device that is unknown or not there, before anything is loaded or made for it."""

from __future__ import annotations

import torch

from asdfviz.errors import InputError


def require_device(name: str) -> None:
    """Try a device.

    Raises:
        InputError: torch does not know it, or it is not in this machine.
    """
    try:
        torch.empty(1, device=name)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise InputError(
            f"device '{name}' cannot be used here, use cpu (or cuda with an NVIDIA card and torch's "
            f"CUDA build): {reason}"
        ) from error
