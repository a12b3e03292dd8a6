from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from asdfviz.datatypes import Assembly, Detection
from asdfviz.detector.network import Network
from asdfviz.geometry.transforms import apply
from asdfviz.train import validation
from asdfviz.train.checkpoint import load_checkpoint, write_checkpoint
from asdfviz.train.config import Stage, TrainConfig
from asdfviz.train.dataset import load_images
from asdfviz.train.session import Session
from asdfviz.train.validation import SCORE, Validation, validate


@pytest.mark.parametrize(("offset", "score"), [(0.0, 1.0), (0.05, 0.5), (0.2, 0.0)])
def test_the_score_is_that_of_pose_errors(
    scene: Path, assembly: Assembly, monkeypatch: pytest.MonkeyPatch, offset: float, score: float
) -> None:
    """Keypoints of parts that are all so far (m) beside the truth, boxes right."""
    images = load_images([scene], (assembly,), image_size=640)
    by_picture = {image.rgb.tobytes(): image for image in images}

    def answer(network: object, rgb: np.ndarray, **_: object) -> tuple[Detection, ...]:
        image = by_picture[rgb.tobytes()]
        found: list[Detection] = []
        for item in image.objects:
            pixels = item.keypoints[:, :2].astype(np.float64)
            if item.part is not None and item.T_camera_part is not None:
                points = apply(item.T_camera_part, assembly.parts[item.part].keypoints)
                projected = (points + np.array([0.0, offset, 0.0])) @ image.K.T
                pixels = projected[:, :2] / projected[:, 2:]
            box = np.concatenate([item.outline.min(0), item.outline.max(0)]).astype(np.float64)
            label = assembly.detector_classes[item.label]
            found.append(Detection(label, box, pixels, np.ones(17), 0.9))
        return tuple(found)

    monkeypatch.setattr(validation, "detect", answer)
    found = validate(Network("n", classes=3), images, (assembly,), image_size=640)
    assert found.score == pytest.approx(score, abs=0.02)


def test_a_run_of_before_judges_its_best_anew(
    scene: Path,
    assembly: Assembly,
    new_config: Callable[..., TrainConfig],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stages = (Stage(1.0, 64, 64, 2, 0.5),)
    config = new_config(validation=(scene,), image_size=64, stages=stages)
    scores: Iterator[float] = iter((0.9, 0.2, 0.3))
    monkeypatch.setattr(
        "asdfviz.train.session.validate", lambda *_, **__: Validation(next(scores), ())
    )
    run = Session(config, [assembly])
    run.validate(None)
    run.checkpoint()
    assert Session(config, [assembly]).progress.best == 0.9
    for name in ("last.pt", "best.pt"):  # as older ones are
        content = load_checkpoint(config.output / name)
        assert content.pop("score") == SCORE
        write_checkpoint(config.output / name, content)
    again = Session(config, [assembly])
    assert again.progress.best == 0.2
    kept = load_checkpoint(config.output / "best.pt")
    assert (kept["progress"][2], kept["score"]) == (0.2, SCORE)
    again.progress.step = 5
    again.validate(None)
    assert load_checkpoint(config.output / "best.pt")["progress"][0] == 5
