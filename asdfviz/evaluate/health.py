"""The sanity gate: looks a sequence over for what makes every later result wrong.

Units, intrinsics, mesh sizes, gaps, images cut off, missing depth, and depth that is shifted against
colour. It looks at a dozen frames at most and at how the other images begin and end, so that the app can
run it on opening.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from collections.abc import Sequence as Rows
from typing import TypeAlias

from asdfviz.data.folder_sequence import FolderSequence
from asdfviz.data.images import ImageSizeError
from asdfviz.data.prefetch import Prefetcher
from asdfviz.datatypes import Frame, Sequence
from asdfviz.errors import SequenceError
from asdfviz.evaluate.health_camera import (
    check_intrinsics,
    check_offsets,
    check_one_camera,
    check_origins,
    check_part_sizes,
    size_finding,
)
from asdfviz.evaluate.health_depth import (
    FARTHEST,
    NEAREST,
    check_distance,
    check_far,
    check_missing_depth,
    median_depth,
)
from asdfviz.evaluate.health_files import (
    check_assembly,
    check_image_sizes,
    check_numbering,
    check_objects,
    check_orientation,
    check_partners,
    check_unread,
)
from asdfviz.evaluate.health_report import Finding as Finding
from asdfviz.evaluate.health_report import HealthReport as HealthReport
from asdfviz.evaluate.health_shift import MOST_SHIFT_FRAMES, measure_shift, spread
from asdfviz.evaluate.health_sights import posed_parts
from asdfviz.evaluate.health_truth import check_against_truth

MOST_FRAMES = 12
LEAST_SHIFT_PX = 3.0
"""Below it the depth sits as well on colour as edges can tell: a time-of-flight camera draws edges
out to one side, by about 2 px at 1280 pixels width."""

Progress: TypeAlias = Callable[[int, int, str], None]
"""Done and in all of what is being done, and what that is."""

_GRAVITY = {"error": 0, "warning": 1, "info": 2}


def check_sequence(sequence: Sequence, *, progress: Progress | None = None) -> HealthReport:
    """Look a sequence over; an assembly and truth widen what can be told, neither is needed.

    Args:
        sequence: what to look at.
        progress: told how far reading, and then each of the longer checks, is.

    Raises:
        SequenceError: the camera or the truth cannot be read at all.
    """
    source = sequence.source if isinstance(sequence, Prefetcher) else sequence
    places = spread(len(source), MOST_FRAMES)
    tell = progress or _untold
    frames, unread = _read_frames(source, places, tell)
    findings: list[Finding] = []
    if isinstance(source, FolderSequence):
        findings = [*check_image_sizes(source), *check_orientation(source)]
    images_wh = None if frames else _common_size(unread)
    if images_wh is None:
        findings += _check_sizes(unread, len(places))
        findings += check_intrinsics(source.camera)
    else:
        findings.append(size_finding(source.camera, images_wh))
    findings += check_unread(unread, source, len(places))
    findings += check_numbering(source.frame_indices)
    if isinstance(source, FolderSequence):
        findings += check_partners(source)
        findings += check_one_camera(source)
        findings += check_assembly(source)
    findings += check_objects(source)
    if source.assembly is not None:
        findings += check_offsets(source.assembly)
        findings += check_origins(source.assembly)
    if frames:
        findings += _check_frames(source, frames, tell)
    tell(len(places), len(places), "")
    return HealthReport(
        sequence=source.name,
        path=source.path,
        frames=len(source),
        frames_looked_at=len(places),
        findings=tuple(sorted(_once(findings), key=lambda finding: _GRAVITY[finding.severity])),
    )


def _untold(done: int, total: int, what: str) -> None:
    """For those who do not ask how far it is."""


def _read_frames(
    source: Sequence, places: list[int], tell: Progress
) -> tuple[dict[int, Frame], list[SequenceError]]:
    """The frames that can be read, by place, and why the others cannot."""
    frames: dict[int, Frame] = {}
    unread: list[SequenceError] = []
    for done, place in enumerate(places):
        try:
            frames[place] = source[place]
        except SequenceError as error:
            unread.append(error)
        tell(done + 1, len(places), "reading")
    return frames, unread


def _common_size(unread: Rows[SequenceError]) -> tuple[int, int] | None:
    """The size of the colour images if none has the camera's, but all have one."""
    sizes = {error.color_wh if isinstance(error, ImageSizeError) else None for error in unread}
    return sizes.pop() if len(sizes) == 1 else None


def _check_sizes(unread: Rows[SequenceError], looked_at: int) -> Iterator[Finding]:
    wrong = [error for error in unread if isinstance(error, ImageSizeError)]
    if wrong:
        yield Finding(
            "size_mismatch",
            "error",
            f"Sizes differ in {len(wrong)} of {looked_at} frames looked at: {wrong[0]}.",
            float(len(wrong)),
        )


def _check_frames(source: Sequence, frames: dict[int, Frame], tell: Progress) -> Iterator[Finding]:
    images = list(frames.values())
    yield from check_missing_depth(images)
    unit = list(check_distance(images))
    yield from unit
    if not unit:
        yield from _check_shift(images, tell)
    if source.assembly is None:
        yield from check_far(images)
        return
    distance = median_depth(images)
    is_plausible = distance is not None and NEAREST <= distance <= FARTHEST
    yield from check_part_sizes(source.assembly, source.camera, distance if is_plausible else None)
    tell(0, 1, "depth against truth")
    with_truth = [(frame, source.truth(place)) for place, frame in frames.items()]
    yield from check_against_truth(posed_parts(with_truth), source.assembly)


def _check_shift(images: Rows[Frame], tell: Progress) -> Iterator[Finding]:
    with_depth = [frame for frame in images if frame.depth is not None]
    chosen = [with_depth[i] for i in spread(len(with_depth), MOST_SHIFT_FRAMES)]
    found = measure_shift(
        chosen, progress=lambda done, total: tell(done, total, "depth against colour")
    )
    if found is None or found.typical_px < LEAST_SHIFT_PX:
        return
    x, y = found.shift_px
    scale = f" and a scale of {found.scale:.3f}" if abs(found.scale - 1.0) > 0.003 else ""
    advice = (
        "Add the colour lens to camera.json as 'distortion', or register depth to colour again."
        if scale
        else "Register depth to colour again (check their common calibration and timing)."
    )
    yield Finding(
        "depth_shift",
        "warning",
        f"Depth has a shift of about {found.typical_px:.1f} px against colour (a quarter of the "
        f"depth edges are farther off; fits a move by ({x:.1f}, {y:.1f}) px{scale}). {advice}",
        found.typical_px,
    )


def _once(findings: list[Finding]) -> list[Finding]:
    """Drop what a second check says of a kind that an error explains already; files speak one by one."""
    kept: list[Finding] = []
    explained: set[str] = set()
    for finding in findings:
        is_new = finding.kind not in explained or finding.kind in (
            "missing_frames",
            "broken_images",
        )
        if is_new:
            kept.append(finding)
        if finding.severity == "error" and finding.kind != "mesh_unit":
            explained.add(finding.kind)
    return kept
