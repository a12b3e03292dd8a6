"""What the generator needs to run."""

from __future__ import annotations

import pickle
import subprocess
import sys
from pathlib import Path

from asdfviz.datatypes import Assembly


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
        "    progress=lambda i, _: done.append(i), stop=lambda: any(done))\n"
        "print(n)\n"
    )
    line = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "1"
