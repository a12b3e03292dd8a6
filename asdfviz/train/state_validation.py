"""What a state network is judged on while it is trained: crops of the training's own kind, and groups
in scenes, both with base poses as methods find them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch.nn.functional import cross_entropy

from asdfviz.datatypes import Assembly
from asdfviz.detector.state_network import StateNetwork
from asdfviz.train.crop_data import CropMaker, Crops
from asdfviz.train.crop_found import found_crops
from asdfviz.train.state_config import StateTrainConfig
from asdfviz.train.state_views import STORED_STATE_PIXELS, StateViewMaker, StateViews

SEED = 987_654_322
"""Kept apart from those of training."""
BATCH = 128


@dataclass(frozen=True, slots=True)
class StateValidation:
    """What weights are worth on one set."""

    name: str
    right: dict[str, float]
    """Of each group shown, the share of crops whose likeliest state is the true one, 0 to 1."""
    mean: float
    """Mean over the groups."""
    surprise: float
    """Mean cross-entropy, nats."""

    def line(self) -> str:
        """For people."""
        each = ", ".join(f"{name} {100 * share:.1f}" for name, share in self.right.items())
        return f"{self.name}: {100 * self.mean:.1f} % right ({each}), {self.surprise:.2f} nats"


def state_validation_sets(
    config: StateTrainConfig,
    maker: CropMaker,
    views: StateViewMaker,
    assemblies: Sequence[Assembly],
) -> dict[str, list[StateViews]]:
    """Views of groups that are never trained on.

    Args:
        config: of the run; its folder keeps the crops, so that every sitting is judged on the same.
        maker: of crops.
        views: shows them.
        assemblies: that the network knows.

    Raises:
        SequenceError: a scene folder is broken or shows none of the assemblies.
    """
    file = config.output / "validation_crops.npz"
    if not file.is_file():
        count = config.validation_crops * sum(len(c.states) for c in maker.classes)
        rng = np.random.default_rng([SEED, config.seed])
        maker.make(count, rng=rng).groups().save(file)
    sets = {"crops": Crops.load(file)}
    if config.validation:
        sets["scenes"] = found_crops(
            config.validation,
            assemblies,
            maker.classes,
            pixels=STORED_STATE_PIXELS,
            only_groups=True,
        ).crops
    return {name: _shown(crops.to(config.device), views) for name, crops in sets.items()}


def _shown(crops: Crops, views: StateViewMaker) -> list[StateViews]:
    rng = np.random.default_rng(SEED)
    starts = range(0, len(crops), BATCH)
    rows = [torch.arange(i, min(i + BATCH, len(crops))) for i in starts]
    return [views.views(crops.taken(part), rng=rng) for part in rows]


@torch.inference_mode()
def validate_states(
    network: StateNetwork,
    batches: Sequence[StateViews],
    views: StateViewMaker,
    groups: Sequence[str],
    *,
    name: str,
) -> StateValidation:
    """Judge weights on a set.

    Args:
        network: in evaluation mode.
        batches: of the set.
        views: knows which states are a group's own.
        groups: their names.
        name: of the set.
    """
    right: list[np.ndarray] = []
    missed: list[np.ndarray] = []
    shown: list[np.ndarray] = []
    for batch in batches:
        logits = network(batch.pictures, batch.groups, batch.poses, batch.focal).float()
        own = views.own_states(logits, batch.groups)
        right.append((own.argmax(1) == batch.states).cpu().numpy())
        missed.append(cross_entropy(own, batch.states, reduction="none").cpu().numpy())
        shown.append(batch.groups.cpu().numpy())
    hits, of = np.concatenate(right), np.concatenate(shown)
    each = {groups[int(g)]: float(hits[of == g].mean()) for g in np.unique(of)}
    mean = float(np.mean(list(each.values())))
    return StateValidation(name, each, mean, float(np.concatenate(missed).mean()))
