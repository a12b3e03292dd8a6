"""The paper's own parts on real Azure Kinect frames, from import to overlay, with shipped weights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asdfviz.data.assembly import load_assembly
from asdfviz.data.gbot_import import import_gbot
from asdfviz.data.run_files import load_run, save_run
from asdfviz.data.sequences import open_sequence
from asdfviz.methods.registry import find_method
from asdfviz.render.overlay import draw_overlay
from asdfviz.render.renderer import Renderer
from asdfviz.run import run


@pytest.mark.shared
def test_asdf_runs_on_the_real_frames_with_the_shipped_weights(
    shared: Path, tmp_path: Path
) -> None:
    files = import_gbot(shared / "data" / "gbot", tmp_path / "models")
    (file,) = [f for f in files if f.parent.name == "gbot_nanovise"]
    assert (file.parent / "weights.safetensors").is_file()
    assembly = load_assembly(file)
    sequence = open_sequence(shared / "data" / "real", assembly=assembly)
    result = run(find_method("asdf"), sequence)
    save_run(result, tmp_path / "run")
    again = load_run(tmp_path / "run", assembly=assembly)
    assert len(again.predictions) == len(sequence) == 3
    assert all(prediction.detections for prediction in again.predictions)
    poses = {n: e.T_camera_part for n, e in again.predictions[0].poses.items()}
    frame = sequence[0]
    renderer = Renderer(frame.camera.width, frame.camera.height)
    try:
        drawn = draw_overlay(frame.rgb, poses, assembly, frame.camera.K, renderer=renderer)
    finally:
        renderer.close()
    assert bool(poses) == bool(np.any(drawn != frame.rgb))
