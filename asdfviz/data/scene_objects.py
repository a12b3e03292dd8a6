"""Reads scene_gt.json: which objects stand in which frame, and which parts of an assembly they are."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asdfviz.data.cameras import frame_number
from asdfviz.data.json_files import Json, read_json
from asdfviz.datatypes import Assembly
from asdfviz.errors import SequenceError
from asdfviz.geometry.shapes import Transform
from asdfviz.geometry.transforms import FARTHEST, is_rigid, orthonormalized, transform_from

SCENE_GT = "scene_gt.json"
SCENE_GT_INFO = "scene_gt_info.json"


@dataclass(frozen=True, slots=True, eq=False)
class SceneObject:
    """One entry of scene_gt.json."""

    obj_id: int | str
    """A number in BOP datasets, the part's name in GBOT's."""
    T_camera_object: Transform
    visible: float | None
    """Visible share of its outline, where scene_gt_info.json gives it."""


def read_scene_objects(folder: Path) -> dict[int, tuple[SceneObject, ...]]:
    """Read every object of every frame, in the order of the file; empty without scene_gt.json.

    Raises:
        SequenceError: with the frame and entry; a pose that is not rigid, a field that is missing.
    """
    file = folder / SCENE_GT
    if not file.is_file():
        return {}
    visible = _read_visible(folder / SCENE_GT_INFO)
    frames: dict[int, tuple[SceneObject, ...]] = {}
    for key, raw in read_json(file, error=SequenceError).items().items():
        index = frame_number(key, raw.where)
        entries = raw.entries()
        shares = visible.get(index, (None,) * len(entries))
        if len(shares) != len(entries):
            raise SequenceError(
                f"{folder / SCENE_GT_INFO}: frame {index} has {len(shares)} entries, but "
                f"{SCENE_GT} has {len(entries)}; they belong together by their order"
            )
        frames[index] = tuple(map(_parse_object, entries, shares))
    return frames


def assign_parts(
    objects: tuple[SceneObject, ...], assembly: Assembly
) -> tuple[dict[str, SceneObject], tuple[SceneObject, ...]]:
    """Split the objects of a frame into parts of the assembly, and the others.

    Names must be equal to the letter, numbers equal to Part.obj_id. Where a dataset repeats a
    number, its entries go in order to the parts that carry it; what is left over is among the
    others, as are objects that the assembly does not know.
    """
    by_number: dict[int | str, list[str]] = {}
    for part in assembly.parts.values():
        by_number.setdefault(part.name, []).append(part.name)
        if part.obj_id is not None:
            by_number.setdefault(part.obj_id, []).append(part.name)
    found: dict[str, SceneObject] = {}
    others: list[SceneObject] = []
    for item in objects:
        free = [name for name in by_number.get(item.obj_id, ()) if name not in found]
        if free:
            found[free[0]] = item
        else:
            others.append(item)
    return found, tuple(others)


def objects_beside(folder: Path, assembly: Assembly) -> tuple[Counter[str], Counter[str]]:
    """Count the entries that stand for no part: of objects that the assembly has not, and repeats of its parts.

    Raises:
        SequenceError: scene_gt.json is broken.
    """
    known = {p.name for p in assembly.parts.values()} | {p.obj_id for p in assembly.parts.values()}
    strangers: Counter[str] = Counter()
    repeats: Counter[str] = Counter()
    for objects in read_scene_objects(folder).values():
        for item in assign_parts(objects, assembly)[1]:
            (repeats if item.obj_id in known else strangers)[str(item.obj_id)] += 1
    return strangers, repeats


def id_kind(folder: Path) -> type[int] | type[str] | None:
    """Whether scene_gt.json names objects by number (BOP) or by name (GBOT); None where it has none.

    Raises:
        SequenceError: the file is broken, or some go by number and some by name.
    """
    file = folder / SCENE_GT
    if not file.is_file():
        return None
    frames = read_json(file, error=SequenceError).items().values()
    kinds = {type(_obj_id(entry)) for frame in frames for entry in frame.entries()}
    if len(kinds) > 1:
        raise SequenceError(
            f"{file} mixes obj_ids that are numbers (BOP) with names (GBOT); use one kind"
        )
    return kinds.pop() if kinds else None


def _obj_id(entry: Json) -> int | str:
    field = entry.get("obj_id")
    if isinstance(field.value, bool) or not isinstance(field.value, (int, str)):
        raise field.fail("a whole number (BOP) or a part's name (GBOT)")
    return field.value


def _parse_object(entry: Json, visible: float | None) -> SceneObject:
    obj_id = _obj_id(entry)
    R = entry.get("cam_R_m2c").numbers(9).reshape(3, 3)
    t_mm = entry.get("cam_t_m2c").numbers(3)
    if np.abs(t_mm).max() >= FARTHEST * 1e3:
        raise entry.get("cam_t_m2c").fail("millimetres")
    T_raw = transform_from(R, t_mm * 1e-3)
    if not is_rigid(T_raw, tolerance=1e-2):
        raise SequenceError(
            f"{entry.where}: cam_R_m2c of '{obj_id}' is no rotation (determinant "
            f"{np.linalg.det(R):.4g}); give 9 numbers row by row with R R^T = 1"
        )
    T = orthonormalized(T_raw)
    T.flags.writeable = False
    return SceneObject(obj_id=obj_id, T_camera_object=T, visible=visible)


def _read_visible(file: Path) -> dict[int, tuple[float | None, ...]]:
    if not file.is_file():
        return {}
    shares: dict[int, tuple[float | None, ...]] = {}
    for key, raw in read_json(file, error=SequenceError).items().items():
        shares[frame_number(key, raw.where)] = tuple(_share(entry) for entry in raw.entries())
    return shares


def _share(entry: Json) -> float | None:
    field = entry.find("visib_fract")
    if field is None:
        return None
    share = field.number()
    # BOP writes -1 where an object has no pixel at all.
    if not -1.0 <= share <= 1.0 + 1e-6:
        raise field.fail("a share from 0 to 1")
    return min(max(share, 0.0), 1.0)
