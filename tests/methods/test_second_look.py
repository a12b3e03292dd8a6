"""The second look: where it looks, and how what it sees comes back into the picture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest

from asdfviz.datatypes import Detection
from asdfviz.errors import MethodError
from asdfviz.methods.assignment import assign_detections
from asdfviz.methods.second_look import SecondLook, SecondLookConfig


@dataclass
class NearSighted:
    """Sees boxes of the frame only through windows, as the window has them."""

    boxes: dict[str, np.ndarray]
    windows: list[tuple[int, int, int, int]] = field(default_factory=list)

    def detect(self, rgb: np.ndarray) -> tuple[Detection, ...]:
        height, width = rgb.shape[:2]
        x, y = int(rgb[0, 0, 0]) + 256 * int(rgb[0, 0, 1]), int(rgb[0, 0, 2])
        self.windows.append((x, y, width, height))
        seen = []
        for label, box in self.boxes.items():
            own = np.clip(box - [x, y, x, y], 0, [width - 1, height - 1] * 2)
            if (own[2:] - own[:2] > 2).all():
                middle = (own[:2] + own[2:]) / 2
                seen.append(Detection(label, own, np.tile(middle, (17, 1)), np.ones(17), 0.4))
        return tuple(seen)


def picture(height: int, width: int) -> np.ndarray:
    """Every pixel holds its own column (in two channels) and row."""
    v, u = np.mgrid[:height, :width]
    return np.stack([u % 256, u // 256, v], axis=2).astype(np.uint8)


def frame_with(toy, *boxes: np.ndarray):
    """A table with something 30 mm high in every box."""
    frame = toy.frame(1, {})
    depth = frame.depth.copy()
    for x0, y0, x1, y1 in (box.astype(int) for box in boxes):
        depth[y0 : y1 + 1, x0 : x1 + 1] -= 0.03
    height, width = depth.shape
    return type(frame)(1, 0.0, picture(height, width), depth, frame.camera)


def looked(toy, detector: NearSighted, *, enabled: bool = True, **options) -> SecondLook:
    config = SecondLookConfig(enabled=enabled, **options)
    return SecondLook(toy.assembly, detector, config=config)


def test_a_missed_part_that_stands_out_is_found_where_it_is(toy) -> None:
    box = np.array([250.0, 40, 290, 70])
    detector = NearSighted({"block": box})
    frame = frame_with(toy, box)
    seen = looked(toy, detector).step(frame, (), {})
    assert [d.label for d in seen] == ["block"]
    np.testing.assert_allclose(seen[0].box_xyxy, box)
    np.testing.assert_allclose(seen[0].keypoints_px[0], [270, 55])
    assert detector.windows == [(160, 0, 160, 120)]


def test_nothing_is_looked_for_that_was_found_or_switched_off(toy, box_at) -> None:
    box = np.array([250.0, 40, 290, 70])
    frame = frame_with(toy, box)
    all_parts = [box_at(name, 60 * i) for i, name in enumerate(("base", "block", "pin", "pin"))]
    found = assign_detections(all_parts, toy.assembly)
    detector = NearSighted({"block": box})
    assert looked(toy, detector).step(frame, all_parts, found) == tuple(all_parts)
    assert looked(toy, detector, enabled=False).step(frame, (), {}) == ()
    assert detector.windows == []
    # Boxes of classes that are not missing do not come in by the window.
    only_pins_missing = {name: found[name] for name in ("base", "block")}
    seen = looked(toy, detector).step(frame, all_parts[:2], only_pins_missing)
    assert seen == tuple(all_parts[:2])
    assert len(detector.windows) == 1


def test_a_box_explains_what_stands_out(toy) -> None:
    box = np.array([250.0, 40, 290, 70])
    detector = NearSighted({})
    wider = np.array([245.0, 35, 295, 75])
    found = {"base": Detection("base", wider, np.zeros((17, 2)), np.ones(17), 0.9)}
    assert looked(toy, detector).step(frame_with(toy, box), (), found) == ()
    assert detector.windows == []


def test_unexplained_things_take_turns(toy) -> None:
    left, right = np.array([20.0, 20, 60, 60]), np.array([250.0, 180, 280, 200])
    detector = NearSighted({})
    second = looked(toy, detector, every=3)
    for _ in range(4):
        second.step(frame_with(toy, left, right), (), {})
    # Both, then nothing until the first may be looked at again.
    assert detector.windows == [(0, 0, 160, 120), (160, 120, 160, 120), (0, 0, 160, 120)]


def test_a_part_that_was_there_a_moment_ago_is_looked_for_there(toy, box_at) -> None:
    frame = frame_with(toy)
    there = box_at("block", 200, 100)
    detector = NearSighted({"block": there.box_xyxy})
    second = looked(toy, detector)
    second.step(frame, (there,), {"block": there})
    seen = second.step(frame, (), {})
    assert [d.label for d in seen] == ["block"]
    np.testing.assert_allclose(seen[0].box_xyxy, there.box_xyxy)


def test_a_box_that_the_window_cuts_off_is_left_out(toy) -> None:
    blob = np.array([150.0, 100, 170, 120])
    wide = np.array([60.0, 100, 260, 120])
    detector = NearSighted({"block": wide})
    assert looked(toy, detector).step(frame_with(toy, blob), (), {}) == ()
    assert len(detector.windows) == 1


@pytest.mark.parametrize("wrong", [{"share": 0.0}, {"share": 1.5}, {"every": 0}])
def test_options_out_of_range_are_refused(toy, wrong) -> None:
    with pytest.raises(MethodError, match="second_look"):
        looked(toy, NearSighted({}), **wrong)
