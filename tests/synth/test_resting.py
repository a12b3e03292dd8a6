"""Things come to rest where their centre of mass stands over what touches the table."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from asdfviz.datatypes import Assembly
from asdfviz.synth.primitives import box, lathe
from asdfviz.synth.resting import center_of_mass, footprint, overlap, resting_faces, support_margin


def test_a_box_rests_on_its_six_sides_mostly_the_large_ones() -> None:
    size = np.array([0.1, 0.06, 0.03])
    faces = resting_faces(box(tuple(size)).vertices)
    assert len(faces) == 6
    share = np.zeros(3)
    for face in faces:
        axis = int(np.abs(face.R_world_part[2]).argmax())
        assert abs(face.R_world_part[2, axis]) > 0.999
        assert face.margin == pytest.approx(np.delete(size, axis).min() / 2, abs=1e-4)
        share[axis] += face.probability
    assert share.sum() == pytest.approx(1.0)
    assert share[2] > share[1] > share[0]


def test_a_top_heavy_cup_never_stands_on_its_tip() -> None:
    cone = lathe(np.array([[0.0, -0.05], [0.003, -0.05], [0.04, 0.05], [0.0, 0.05]]), segments=32)
    center = center_of_mass(cone)
    assert center[2] == pytest.approx(0.023, abs=0.004)
    faces = resting_faces(cone.vertices, center=center)
    downs = np.array([-f.R_world_part[2] for f in faces])
    assert (downs[:, 2] > -0.99).all()
    assert downs[:, 2].max() > 0.999
    for face in faces:
        assert support_margin(cone.vertices - center, -face.R_world_part[2]) == pytest.approx(
            face.margin
        )


def test_the_centre_of_mass_of_a_shifted_box() -> None:
    mesh = box((0.02, 0.04, 0.06))
    shifted = type(mesh)(mesh.vertices + np.array([0.1, -0.2, 0.3]), mesh.faces)
    assert np.allclose(center_of_mass(shifted), [0.1, -0.2, 0.3])


def test_footprints_are_counter_clockwise_and_overlap_by_their_gap() -> None:
    outline = footprint(box((0.02, 0.02, 0.02)).vertices)
    x, y = outline.T
    assert (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() == pytest.approx(2 * 0.02**2)
    assert not overlap(outline, outline + np.array([0.03, 0.0]), gap=0.009)
    assert overlap(outline, outline + np.array([0.03, 0.0]), gap=0.011)


def test_the_generator_needs_torch_numpy_and_opencv_alone(toy: Assembly, tmp_path: Path) -> None:
    """An assembly that is in memory becomes a sequence's first frame without any mesh library."""
    (tmp_path / "toy.pickle").write_bytes(pickle.dumps(toy))
    code = (
        "import pickle, sys\n"
        "from pathlib import Path\n"
        "for n in ('scipy', 'trimesh', 'manifold3d', 'pyrender', 'OpenGL', 'viser', 'numba'):\n"
        "    sys.modules[n] = None\n"
        "import asdfviz.synth.images, asdfviz.synth.packs\n"
        "from asdfviz.synth.sequences import SequenceConfig, generate_sequence\n"
        "folder = Path(sys.argv[1])\n"
        "toy = pickle.loads((folder / 'toy.pickle').read_bytes())\n"
        "small = dict(width=64, height=64)\n"
        "done = []\n"
        "n = generate_sequence(toy, seed=1, folder=folder / 'b', config=SequenceConfig(**small),\n"
        "    progress=lambda i, _: done.append(i), stop=lambda: bool(done))\n"
        "print(n)\n"
    )
    line = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "1"
