"""A rough pose in one frame of the sample, settled by what the frame shows."""

from __future__ import annotations

import numpy as np
import pytest

from asdfviz.data.sequences import open_sequence
from asdfviz.errors import InputError
from asdfviz.geometry.transforms import point_distance, rotation_about
from asdfviz.methods.tracking import load_bodies
from asdfviz.track.fitting import fitted

PLACE = 5
"""All parts can be seen whole."""


@pytest.mark.parametrize("part", ["base", "jaw", "bolt"])
def test_a_pose_that_is_some_millimetres_off_is_settled(part: str) -> None:
    sequence = open_sequence("sample")
    assert sequence.assembly is not None
    truth = sequence.truth(PLACE)
    assert truth is not None
    T, middle = truth.T_camera_part[part], sequence.assembly.parts[part].middle
    rough = T.copy()
    rough[:3, :3] = rotation_about(np.array([0.2, 1.0, -0.4]), 0.1) @ T[:3, :3]
    rough[:3, 3] = T[:3, :3] @ middle + T[:3, 3] - rough[:3, :3] @ middle + [0.004, -0.003, 0.006]
    body, frame = load_bodies(sequence.assembly)[part], sequence[PLACE]
    found = fitted(frame, rough, body=body, camera=sequence.camera)
    assert found is not None
    assert point_distance(found.T_camera_part, T, middle) < 0.003
    assert point_distance(rough, T, middle) > 0.007
    away = rough.copy()
    away[:3, 3] += [0.1, 0.1, 0.1]
    assert fitted(frame, away, body=body, camera=sequence.camera) is None


def test_a_frame_of_another_size_is_refused() -> None:
    sequence = open_sequence("sample")
    assert sequence.assembly is not None
    truth = sequence.truth(PLACE)
    assert truth is not None
    other = open_sequence("sample").camera
    half = type(other)(other.K / 2, other.width // 2, other.height // 2)
    body = load_bodies(sequence.assembly)["jaw"]
    with pytest.raises(InputError, match="the tracker's camera"):
        fitted(sequence[PLACE], truth.T_camera_part["jaw"], body=body, camera=half)
