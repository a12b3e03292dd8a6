from __future__ import annotations

import json
from dataclasses import replace

import pytest

from asdfviz.bench.first_poses import first_pose_table, measure_first_poses, some_frames
from asdfviz.cli.bench import BenchFirstPoses
from asdfviz.data.sequences import open_sequence
from asdfviz.datatypes import Frame, FrameTruth
from asdfviz.errors import InputError
from asdfviz.methods.first_pose import CropPoseConfig


@pytest.fixture(scope="module")
def shown() -> list[tuple[Frame, FrameTruth]]:
    sequence = open_sequence("sample")
    assert sequence.assembly is not None
    truth = {index: sequence.truth(k) for k, index in enumerate(sequence.frame_indices)}
    return some_frames(sequence, {i: t for i, t in truth.items() if t is not None}, 3)


def test_frames_come_from_the_whole_sequence(shown: list[tuple[Frame, FrameTruth]]) -> None:
    assert [frame.index for frame, _ in shown] == [0, 31, 62]
    assert all(frame.index == truth.frame_index for frame, truth in shown)


def test_more_parts_than_there_are_come_again(shown: list[tuple[Frame, FrameTruth]]) -> None:
    assembly = open_sequence("sample").assembly
    assert assembly is not None
    done = list[tuple[int, int]]()
    measured = measure_first_poses(
        assembly,
        shown[:2],
        parts=5,
        config=CropPoseConfig(),
        progress=lambda at, total: done.append((at, total)),
    )
    assert (measured.parts, measured.frames) == (5, 2)
    assert measured.network_ms > 0
    assert 0 < measured.whole_ms <= measured.whole_p90_ms
    assert done == [(1, 2), (2, 2)]
    assert "nine parts on two cores" in first_pose_table(measured)


def test_a_frame_without_parts_is_told(shown: list[tuple[Frame, FrameTruth]]) -> None:
    assembly, (frame, truth) = open_sequence("sample").assembly, shown[0]
    assert assembly is not None
    hidden = replace(truth, visible=dict.fromkeys(truth.T_camera_part, 0.1))
    with pytest.raises(InputError, match="frame 0: no part has a true pose and is seen to 30%"):
        measure_first_poses(assembly, [(frame, hidden)], parts=2, config=CropPoseConfig())


def test_the_command_wants_parts_frames_and_truth(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(InputError, match="0 parts in 1 frames"):
        BenchFirstPoses(parts=0, frames=1)()
    with pytest.raises(InputError, match="2 parts in 0 frames"):
        BenchFirstPoses(parts=2, frames=0)()
    BenchFirstPoses(parts=1, frames=1, json=True)()
    assert json.loads(capsys.readouterr().out)["parts"] == 1
