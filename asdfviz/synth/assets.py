"""All meshes that the pictures of one assembly need, uploaded once: parts, distractors, hands, sleeves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float64

from asdfviz.datatypes import Assembly, Mesh
from asdfviz.pose.resting import RestingFace, center_of_mass, resting_faces
from asdfviz.synth.description import Placed
from asdfviz.synth.hands import GRASPS, HandMesh, hand_mesh
from asdfviz.synth.memory import keep_freed_memory
from asdfviz.synth.mesh_bank import MeshBank, clustered
from asdfviz.synth.primitives import distractor_meshes

Cloud = Float64[np.ndarray, "_ 3"]
"""Points whose number differs from cloud to cloud."""
SLEEVE_CUTS = (0.015, 0.11)
"""Where sleeves end, metres from the wrist towards the elbow."""
CASTER_CELLS = (0.005, 0.012, 0.010)
"""Detail, in metres, of the shadows of fingers, arms and sleeves: four fifths of a picture's triangles."""


@dataclass(frozen=True, slots=True, eq=False)
class Assets:
    """Meshes on a device and what layouts need to know of them."""

    assembly: Assembly
    bank: MeshBank
    parts: Mapping[str, int]
    """Index of each part's mesh in the bank."""
    distractors: range
    hands: range
    """One a grasp, in the order of `hands.GRASPS`."""
    sleeves: range
    """For each grasp one a cut."""
    resting: Mapping[str, tuple[RestingFace, ...]]
    distractor_points: tuple[Cloud, ...]

    def points_of(self, distractor: Placed) -> Cloud:
        """The points of one that is placed, in its own frame."""
        return self.distractor_points[distractor.mesh - self.distractors.start]


def load_assets(assembly: Assembly, *, device: str = "cpu") -> Assets:
    """Mesh the hands, find resting faces and upload everything."""
    keep_freed_memory()
    meshes: list[Mesh] = [part.mesh for part in assembly.parts.values()]
    parts = {name: i for i, name in enumerate(assembly.parts)}
    solids = distractor_meshes()
    distractors = range(len(meshes), len(meshes) + len(solids))
    meshes += solids
    hands = [hand_mesh(i) for i in range(len(GRASPS))]
    hand_range = range(len(meshes), len(meshes) + len(hands))
    meshes += [hand.mesh for hand in hands]
    sleeves = [_sleeve(i, cut) for i in range(len(hands)) for cut in SLEEVE_CUTS]
    sleeve_range = range(len(meshes), len(meshes) + len(sleeves))
    meshes += sleeves
    casters = {i: _hand_caster(k) for k, i in enumerate(hand_range)}
    nails = {i: hand.nails for i, hand in zip(hand_range, hands, strict=True)}
    casters |= {i: _sleeve_caster(meshes[i]) for i in sleeve_range}
    return Assets(
        assembly=assembly,
        bank=MeshBank.of(
            meshes,
            device=device,
            casters=casters,
            marks=nails,
            rounded=hand_range,
            lasting=range(distractors.start, len(meshes)),
        ),
        parts=parts,
        distractors=distractors,
        hands=hand_range,
        sleeves=sleeve_range,
        resting={name: _resting(part.mesh) for name, part in assembly.parts.items()},
        distractor_points=tuple(m.vertices for m in solids),
    )


_known: WeakKeyDictionary[Mesh, tuple[RestingFace, ...]] = WeakKeyDictionary()
"""Resting faces of the meshes that this process has loaded and still has."""


def _resting(mesh: Mesh) -> tuple[RestingFace, ...]:
    if mesh not in _known:
        _known[mesh] = resting_faces(mesh.vertices, center=center_of_mass(mesh))
    return _known[mesh]


@cache
def _hand_caster(grasp: int) -> Mesh:
    """What throws a hand's shadow."""
    finger, arm, _ = CASTER_CELLS
    hand = hand_mesh(grasp)
    return clustered(hand.mesh, np.where(hand.along_arm > 0.02, arm, finger))


@cache
def _sleeve_caster(sleeve: Mesh) -> Mesh:
    return clustered(sleeve, CASTER_CELLS[2])


@cache
def _sleeve(grasp: int, cut: float) -> Mesh:
    return sleeve_of(hand_mesh(grasp), cut)


def sleeve_of(hand: HandMesh, cut: float) -> Mesh:
    """The forearm's surface beyond `cut`, lifted a few millimetres and wrinkled."""
    vertices, faces = hand.mesh.vertices, hand.mesh.faces
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    across = np.cross(b - a, c - a)
    corner = faces.T.reshape(-1)
    sums = [np.bincount(corner, np.tile(column, 3), len(vertices)) for column in across.T]
    normals = np.stack(sums, axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
    along = hand.along_arm
    wrinkle = np.sin(along * 170) * np.sin(vertices[:, 0] * 90 + along * 60)
    hem = 0.003 * np.exp(-np.clip(along - cut, 0, None) / 0.006)
    lift = 0.0065 + 0.0022 * wrinkle + hem
    kept = (along[faces] > cut).all(axis=1)
    used, renumbered = np.unique(faces[kept], return_inverse=True)
    lifted = (vertices + normals * lift[:, None])[used]
    return Mesh(lifted, renumbered.reshape(-1, 3).astype(np.int32))
