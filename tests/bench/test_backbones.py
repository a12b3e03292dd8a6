from __future__ import annotations

import numpy as np

from asdfviz.bench.backbones import network_time
from asdfviz.detector.detector import DetectorConfig


def test_a_network_is_timed_without_training() -> None:
    picture = np.zeros((48, 64, 3), dtype=np.uint8)
    config = DetectorConfig(image_size=64)
    small = network_time("n", [picture, picture], classes=("a", "b"), config=config)
    # The public size n has 3.3 million weights with a pose head.
    assert 3.0 < small.million_weights < 3.6
    assert small.ms > 0
