"""Several processes that train one network together, as torchrun starts them.

Every process draws its own inputs; gradients are averaged before each step, so all hold the same
weights. The first one alone logs, validates and writes.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass

import torch
from torch import Tensor, distributed

from asdfviz.errors import InputError


@dataclass(frozen=True, slots=True)
class World:
    """This process among those that train together; a single one by default."""

    rank: int = 0
    size: int = 1
    device: str = "cpu"

    @property
    def is_first(self) -> bool:
        """Whether this process logs, validates and writes."""
        return self.rank == 0

    @property
    def is_shared(self) -> bool:
        """Whether there are others."""
        return self.size > 1

    def agree(self, value: float) -> float:
        """Return the first process's value in all of them."""
        if not self.is_shared:
            return value
        shared = torch.tensor([value], dtype=torch.float64, device=self.device)
        distributed.broadcast(shared, src=0)
        return float(shared.item())

    def leave(self) -> None:
        """Part from the others; call it once, at the end."""
        if self.is_shared:
            distributed.destroy_process_group()

    def average_gradients(self, parameters: Iterable[Tensor]) -> None:
        """Replace every gradient by its mean over the processes; one that is missing counts as 0.

        Args:
            parameters: the same ones in every process, whatever its batch gives gradients to.
        """
        if not self.is_shared:
            return
        gradients: list[Tensor] = []
        for parameter in parameters:
            if parameter.requires_grad:
                if parameter.grad is None:  # nothing in this process's batch asks for it
                    parameter.grad = torch.zeros_like(parameter)
                gradients.append(parameter.grad)
        flat = torch.cat([g.flatten() for g in gradients])
        distributed.all_reduce(flat)  # pyright: ignore[reportUnknownMemberType] - untyped in torch
        flat /= self.size
        first = 0
        for gradient in gradients:
            gradient.copy_(flat[first : first + gradient.numel()].view_as(gradient))
            first += gradient.numel()


def join_world(device: str) -> World:
    """Join the processes that torchrun started; alone without it.

    Args:
        device: "cuda" becomes this process's own GPU.

    Raises:
        InputError: torchrun's variables are incomplete.
    """
    size = int(os.environ.get("WORLD_SIZE", "1"))
    if size == 1:
        return World(device=device)
    if "RANK" not in os.environ or "MASTER_ADDR" not in os.environ:
        raise InputError("WORLD_SIZE is set but RANK or MASTER_ADDR is not: start it with torchrun")
    on_gpu = torch.device(device).type == "cuda"
    own = f"cuda:{os.environ.get('LOCAL_RANK', '0')}" if on_gpu else device
    if not distributed.is_initialized():
        distributed.init_process_group("nccl" if on_gpu else "gloo")  # pyright: ignore[reportUnknownMemberType] - untyped in torch
    return World(rank=int(os.environ["RANK"]), size=size, device=own)
