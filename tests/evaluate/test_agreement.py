"""Poses against measured depth: what the figures say of poses that are right, off, hidden, and nowhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from memory_sequence import MemorySequence

from asdfviz.datatypes import Assembly, Camera, Frame, FramePrediction, Run
from asdfviz.errors import RunError, SequenceError, Stopped
from asdfviz.evaluate.agreement import FrameAgreement, agreement, agreement_table
from asdfviz.geometry.transforms import rotation_about, transform_from
from asdfviz.render.renderer import Renderer

TRUE = {
    "plate": transform_from(
        rotation_about(np.array([1.0, 0.2, 0]), 0.4), np.array([-0.03, 0.0, 0.5])
    ),
    "block": transform_from(
        rotation_about(np.array([0.1, 1.0, 0]), 0.3), np.array([0.05, 0.02, 0.5])
    ),
}
Judge = Callable[..., dict[str, Any]]


@pytest.fixture
def frame(assembly: Assembly, camera: Camera) -> Frame:
    meshes = [assembly.parts[name].mesh for name in TRUE]
    with Renderer(camera.width, camera.height) as renderer:
        depth, _ = renderer.depth_and_ids(meshes, list(TRUE.values()), camera.K)
    depth[depth == 0] = 0.6
    return Frame(0, 0.0, np.zeros((camera.height, camera.width, 3), np.uint8), depth, camera)


@pytest.fixture
def judge(
    assembly: Assembly,
    frame: Frame,
    make_prediction: Callable[..., FramePrediction],
    make_run: Callable[..., Run],
) -> Judge:
    def build(
        poses: dict[str, np.ndarray], *, depth: np.ndarray | None = frame.depth, **options: Any
    ) -> dict[str, Any]:
        sequence = MemorySequence((replace(frame, depth=depth),), (None,), assembly, "/nowhere")
        run = make_run([make_prediction(0, poses)])
        return agreement(run, sequence, assembly, register=False, **options)

    return build


def test_true_poses_agree_exactly(judge: Judge) -> None:
    found = judge(TRUE)
    assert found["pooled"]["residual_mm_p90"] == pytest.approx(0.0, abs=0.01)
    assert found["pooled"]["visible"] == 100.0
    assert found["parts"]["rod"] == {
        "frames": 0, "read": 0.0, "visible": None, "residual_mm_median": None,
        "residual_mm_p90": None, "deeper_mm_median": None, "near": None,
    }  # fmt: skip
    assert "rod" in agreement_table(found)


@pytest.mark.parametrize("off", [-0.008, 0.004])
def test_a_part_that_is_too_near_is_seen_deeper(judge: Judge, off: float) -> None:
    pushed = TRUE["plate"].copy()
    pushed[:3, 3] *= 1 + off / pushed[2, 3]
    plate = judge({**TRUE, "plate": pushed})["parts"]["plate"]
    assert plate["deeper_mm_median"] == pytest.approx(-1e3 * off, abs=0.6)
    assert plate["residual_mm_median"] == pytest.approx(1e3 * abs(off), abs=0.6)
    assert (plate["near"] > 50) == (abs(off) < 0.005)


def test_what_something_hides_is_left_out(judge: Judge, frame: Frame) -> None:
    assert frame.depth is not None
    depth = frame.depth.copy()
    depth[:, : depth.shape[1] * 9 // 20] = 0.3
    plate = judge(TRUE, depth=depth)["parts"]["plate"]
    assert 5 < plate["visible"] < 95
    assert plate["residual_mm_p90"] == pytest.approx(0.0, abs=0.01)


def test_holes_in_depth_say_nothing(judge: Judge, frame: Frame) -> None:
    assert frame.depth is not None
    depth = frame.depth.copy()
    depth[::2] = 0
    pooled = judge(TRUE, depth=depth)["pooled"]
    assert pooled["read"] == pytest.approx(50, abs=5)
    assert pooled["residual_mm_median"] == pytest.approx(0.0, abs=0.01)


def test_the_picture_is_red_where_the_camera_saw_deeper(judge: Judge) -> None:
    pushed = TRUE["plate"].copy()
    pushed[:3, 3] *= 1 - 0.02 / pushed[2, 3]
    seen: list[FrameAgreement] = []
    judge({"plate": pushed}, seen=seen.append)
    (one,) = seen
    painted = one.picture[(one.picture != 0).any(axis=2) & (one.picture != 255).any(axis=2)]
    red, _, blue = np.median(painted, axis=0)
    assert red > blue + 50
    assert one.residual_mm == pytest.approx(20, abs=2)


def test_a_run_without_depth_says_so(judge: Judge) -> None:
    with pytest.raises(SequenceError, match="no frame of the run has depth"):
        judge(TRUE, depth=None)


def test_a_run_of_other_frames_or_parts_is_told(
    assembly: Assembly,
    frame: Frame,
    make_prediction: Callable[..., FramePrediction],
    make_run: Callable[..., Run],
) -> None:
    sequence = MemorySequence((frame,), (None,), assembly, "/nowhere")
    for numbers, said in (([7, 8], "frames 7 to 8"), ([], "no frames")):
        run = make_run([make_prediction(i, TRUE) for i in numbers])
        with pytest.raises(RunError, match=f"holds {said}, /nowhere frame 0: they share none"):
            agreement(run, sequence, assembly)
    with pytest.raises(RunError, match=r"part 'nut' is not in .*; parts: plate"):
        agreement(make_run([make_prediction(0, {"nut": TRUE["plate"]})]), sequence, assembly)


def test_it_can_be_stopped(judge: Judge) -> None:
    with pytest.raises(Stopped):
        judge(TRUE, stop=lambda: True)
