"""How long every size of the network takes for a picture here; weights do not matter for that."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asdfviz.detector.detector import Detector, DetectorConfig
from asdfviz.detector.network import Network, Scale
from asdfviz.detector.weights import save_network
from asdfviz.geometry.shapes import Rgb


@dataclass(frozen=True, slots=True)
class NetworkTime:
    """One size of the network."""

    million_weights: float
    ms: float
    """Median time of a picture, from pixels to boxes."""


def network_time(
    scale: Scale, pictures: Sequence[Rgb], *, classes: Sequence[str], config: DetectorConfig
) -> NetworkTime:
    """Time a network of random weights on pictures; one runs before the clock starts.

    Args:
        scale: size of the network.
        pictures: at least one.
        classes: as many as it would have.
        config: input size, device and backend.
    """
    network = Network(scale, classes=len(classes))
    count = sum(weights.numel() for weights in network.parameters())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "random.safetensors"
        save_network(network, path, classes=classes, image_size=config.image_size)
        detector = Detector(path, config=config)
    detector.detect(pictures[0])
    seconds: list[float] = []
    for rgb in pictures:
        start = time.perf_counter()
        detector.detect(rgb)
        seconds.append(time.perf_counter() - start)
    return NetworkTime(count / 1e6, 1e3 * float(np.median(seconds)))
