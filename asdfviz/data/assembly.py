"""Reads assembly.yaml: parts, meshes, symmetries, states, errors, transitions.

The layout is described in docs of `load_assembly`; whatever is wrong is one clear AssemblyError.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
import yaml

from asdfviz.data.meshes import METRES_PER_UNIT, default_keypoints, read_mesh
from asdfviz.data.path_names import check_name
from asdfviz.data.resources import bundled_assemblies
from asdfviz.data.states_section import parse_states
from asdfviz.data.yaml_fields import Fields, load_yaml
from asdfviz.datatypes import KEYPOINTS, Assembly, Mesh, Part
from asdfviz.errors import AssemblyError
from asdfviz.geometry.sampling import diameter
from asdfviz.geometry.shapes import Points
from asdfviz.geometry.symmetry import Axis, Symmetries

FILE_KEYS = ("name", "title", "unit", "base", "parts", "states", "errors", "transitions")
PART_KEYS = ("mesh", "unit", "color", "keypoints", "detector_class", "obj_id", "symmetries")
LONGEST_NAME = 255
"""Bytes that file systems take as the name of a folder."""

# Okabe and Ito's colours, for parts whose real colour nobody gave.
FALLBACK_COLORS = (
    (0, 114, 178),
    (230, 159, 0),
    (0, 158, 115),
    (204, 121, 167),
    (213, 94, 0),
    (86, 180, 233),
    (240, 228, 66),
)


def find_assembly(name_or_path: str | Path) -> Path:
    """Return the assembly.yaml that a name, a folder or a file stands for.

    Raises:
        AssemblyError: nothing of that name is bundled and no such path exists, or its name is no text.
    """
    bundled = bundled_assemblies()
    if str(name_or_path) in bundled:
        return bundled[str(name_or_path)]
    path = Path(name_or_path).expanduser()
    file = path / "assembly.yaml" if path.is_dir() else path
    if not file.is_file():
        raise AssemblyError(
            f"no assembly at '{name_or_path}': give a folder with an assembly.yaml or one of the "
            f"bundled ones: {', '.join(bundled) or 'none'}"
        )
    file = file.resolve()
    check_name(file, error=AssemblyError)
    return file


def load_assembly(name_or_path: str | Path) -> Assembly:
    """Read an assembly and check all of it.

    The file holds `name`, `title`, `unit` (mm, cm or m: of the meshes and of every length in the
    file), `base`, `parts`, `states` (in order), `errors` and `transitions`. A part has `mesh` and,
    if wanted, `unit` (of its mesh), `color` (0 to 255), `keypoints` (text file, 17 rows x y z in
    metres; otherwise farthest points of the mesh), `detector_class`, `obj_id` and `symmetries`
    (`discrete`: rows of 16 numbers, `continuous`: `axis`, `offset`). A state has `name`, `poses`
    (part: `R` 9 numbers row by row, `t` 3 numbers, part to base frame) for the joined parts, and
    `joints` (part: `kind`, `axis`, `origin`, `slide`, `turn` in degrees, in the base frame, `link`);
    a state repeats nothing: what an earlier state joined stays joined. Parts whose joints share
    axis, origin and a range move by that range together (a screw and the plate on its tip). Joints
    with one `link` are geared together, from the lower ends of all their ranges to the upper ones
    (a rack and its gears, or a screw's travel and its own turn). An error has `after` too, and
    `remove`, the parts of that state that are missing in it.

    Raises:
        AssemblyError: with the file, the part or state, and what would be right.
    """
    file = find_assembly(name_or_path)
    fields = Fields(_read_yaml(file), where=str(file))
    fields.only(*FILE_KEYS)
    unit = fields.choice("unit", tuple(METRES_PER_UNIT))
    raw_parts = fields.mapping("parts")
    if not raw_parts:
        raise AssemblyError(f"{file}: 'parts' is empty")
    parts = {
        name: _parse_part(str(name), Fields(raw, where=f"{file}: part '{name}'"), file, unit, i)
        for i, (name, raw) in enumerate(raw_parts.items())
    }
    _check_numbers(parts, file)
    base = fields.text("base")
    if base not in parts:
        raise AssemblyError(f"{file}: base '{base}' is not a part; parts: {', '.join(parts)}")
    scale = METRES_PER_UNIT[unit]
    states, transitions = parse_states(fields, base=base, parts=tuple(parts), scale=scale)
    part_classes = list(dict.fromkeys(p.detector_class for p in parts.values()))
    classes = [*part_classes, *(s.detector_class for s in states if s.detector_class)]
    if len(set(classes)) != len(classes):
        raise AssemblyError(f"{file}: two detector classes have one name: {', '.join(classes)}")
    name = fields.text("name")
    _check_name(name, file)
    return Assembly(
        name=name,
        title=fields.text("title", default=name),
        base=base,
        parts=parts,
        states=states,
        transitions=transitions,
        detector_classes=tuple(classes),
        path=str(file),
    )


def _check_name(name: str, file: Path) -> None:
    """Refuse a name that is no plain folder's: results lie in folders that bear it."""
    size = len(name.encode("utf-8", "surrogatepass"))
    is_strange = any(c in "/\\" or c < " " or "\ud800" <= c <= "\udfff" for c in name)
    if is_strange or name.startswith(".") or not name.strip() or size > LONGEST_NAME:
        raise AssemblyError(
            f"{file}: name is {name[:60]!r}; folders bear it, so use 1 to {LONGEST_NAME} bytes "
            "of text, no slash in it and no dot at its start"
        )


def _check_numbers(parts: Mapping[str, Part], file: Path) -> None:
    """Refuse a number that two different parts have: datasets name parts by it."""
    first: dict[int | None, Part] = {}
    for part in parts.values():
        other = first.setdefault(part.obj_id, part)
        same = np.array_equal(other.mesh.vertices, part.mesh.vertices)
        if not (same and np.array_equal(other.mesh.faces, part.mesh.faces)):
            raise AssemblyError(
                f"{file}: parts '{other.name}' and '{part.name}' both have obj_id {part.obj_id} "
                "(without one, a part has its place in the list): give each its own; copies of one "
                "mesh may share one"
            )


def _read_yaml(file: Path) -> Mapping[str, Any]:
    try:
        content = load_yaml(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, OSError) as error:
        reason = " ".join(str(error).split())  # YAML's own messages have several lines
        raise AssemblyError(f"{file} cannot be read: {reason}") from error
    if not isinstance(content, dict):
        raise AssemblyError(f"{file} is not a YAML mapping")
    return cast(Mapping[str, Any], content)


def _parse_part(name: str, fields: Fields, file: Path, unit: str, place: int) -> Part:
    fields.only(*PART_KEYS)
    own_unit = fields.choice("unit", tuple(METRES_PER_UNIT), default=unit)
    mesh = read_mesh(file.parent / fields.text("mesh"), unit=own_unit, part=name)
    size = diameter(mesh.vertices)
    if not 1e-3 < size < 3.0:
        is_own = "unit" in fields.content
        raise AssemblyError(
            f"{fields.where}: the mesh is {size:.4g} m across, which no part of an assembly is; "
            f"{_unit_advice(fields.text('mesh'), own_unit, is_own=is_own, is_small=size <= 1e-3)}"
        )
    color = fields.numbers("color", 3, default=FALLBACK_COLORS[place % len(FALLBACK_COLORS)])
    if color.min() < 0 or color.max() > 255 or (color % 1).any():
        raise AssemblyError(
            f"{fields.where}: 'color' must be red, green and blue, whole numbers from 0 to 255, "
            f"got {color.tolist()}"
        )
    return Part(
        name=name,
        mesh=mesh,
        keypoints=_keypoints(fields, file, mesh),
        symmetries=_symmetries(fields, METRES_PER_UNIT[own_unit]),
        diameter=size,
        color=color.astype(np.uint8),
        detector_class=fields.text("detector_class", default=name),
        obj_id=fields.integer("obj_id", default=place + 1),
    )


def _unit_advice(mesh: str, unit: str, *, is_own: bool, is_small: bool) -> str:
    """What to write instead of a unit that makes a mesh too small or too large."""
    likely = "m" if is_small else "mm"
    if is_own:
        return f"its own 'unit' says {unit}: should it be {likely}?"
    return (
        f"the assembly's 'unit' says {unit}: if this mesh alone is in {likely} (glTF and GLB are in m "
        f"by definition), give the part a unit of its own, {{mesh: {mesh}, unit: {likely}}}; if all "
        f"are, should the assembly's be {likely}?"
    )


def _keypoints(fields: Fields, file: Path, mesh: Mesh) -> Points:
    given = fields.text("keypoints", default="")
    if not given:
        return default_keypoints(mesh)
    path = file.parent / given
    try:
        points = np.loadtxt(path, dtype=np.float64, ndmin=2)
    except (OSError, ValueError) as error:
        raise AssemblyError(f"{fields.where}: keypoints {path} cannot be read: {error}") from error
    if points.shape != (KEYPOINTS, 3) or not np.isfinite(points).all():
        raise AssemblyError(
            f"{fields.where}: keypoints {path} has shape {points.shape}, expected "
            f"({KEYPOINTS}, 3), in metres"
        )
    if np.abs(points).max() > 2.0:
        raise AssemblyError(f"{fields.where}: keypoints {path} must be in metres, not millimetres")
    return points


def _symmetries(fields: Fields, scale: float) -> Symmetries:
    raw = Fields(fields.mapping("symmetries"), where=f"{fields.where}: symmetries")
    raw.only("discrete", "continuous")
    discrete = [raw.transform_row(row, scale) for row in raw.sequence("discrete")]
    axes: list[Axis] = []
    for entry in raw.sequence("continuous"):
        item = Fields(entry, where=raw.where)
        item.only("axis", "offset")
        direction = item.numbers("axis", 3)
        length = float(np.linalg.norm(direction))
        if length < 1e-9:
            raise AssemblyError(f"{raw.where}: an axis has length 0")
        axes.append(Axis(direction / length, item.numbers("offset", 3, default=(0, 0, 0)) * scale))
    return Symmetries(tuple(discrete), tuple(axes))
