"""Checks on the files of a sequence: gaps, frames without a partner, objects that are no parts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from collections.abc import Sequence as Rows
from itertools import chain, islice, pairwise
from pathlib import Path

import numpy as np
from PIL import Image
from PIL.ExifTags import Base

from asdfviz.data.folder_sequence import FolderSequence
from asdfviz.data.image_files import kind_and_end
from asdfviz.data.images import DEPTH_KINDS, READ_KINDS, ImageKindError, ImageSizeError, told_kind
from asdfviz.data.scene_objects import objects_beside
from asdfviz.data.sequences import shows_drawn_copies
from asdfviz.datatypes import Sequence
from asdfviz.errors import SequenceError, counted, some
from asdfviz.evaluate.health_report import Finding
from asdfviz.evaluate.numbering import clock_rise, frame_counts, usual_step

NAMED = 6
"""Missing frames that are named, of however many."""


def check_numbering(indices: Rows[int]) -> Iterator[Finding]:
    """Look for gaps in rising frame numbers; numbers that rise by a fixed step have none, which is told."""
    step, tick = usual_step(indices), clock_rise(indices)
    if tick is not None:
        yield from _check_times(indices, tick)
        return
    if step is None:
        return
    rises = [b - a for a, b in pairwise(indices)]
    if step > 1 and 2 * rises.count(step) > len(rises):
        yield Finding(
            "frame_step",
            "info",
            f"frame numbers go up in steps of {step}: if the recording has frames between them, copy "
            f"those too. Without them parts move {step} times as far from one frame to the next, and "
            "trackers lose them sooner.",
            float(step),
        )
    # Counted, not listed: one image that is named by date and time leaves billions out.
    count = sum((rise - 1) // step for rise in rises)
    if count:
        between = (range(a + step, b, step) for a, b in pairwise(indices))
        first = islice(chain.from_iterable(between), NAMED)
        yield Finding(
            "missing_frames",
            "warning",
            f"{counted(count, 'missing frame')} between {indices[0]} and {indices[-1]}: "
            f"{some(first, most=NAMED, count=count)}. Copy them again, or know that time jumps there.",
            float(count),
        )


def _check_times(indices: Rows[int], tick: int) -> Iterator[Finding]:
    """Look for gaps in frame numbers that are times, usually a `tick` apart."""
    yield Finding(
        "frame_step",
        "info",
        f"frame numbers look like times, about {tick} apart. They serve as names alone: depth, truth and "
        "results must have the very same ones, and frames per second are those of sequence.json.",
        float(tick),
    )
    counts = frame_counts(indices)
    lacking = {a: counts[b] - counts[a] - 1 for a, b in pairwise(indices)}
    before = [index for index, count in lacking.items() if count > 0]
    if before:
        count = sum(lacking[index] for index in before)
        yield Finding(
            "missing_frames",
            "warning",
            f"About {counted(count, 'missing frame')} by their times, after {some(before)}. "
            "Copy them again, or know that time jumps there.",
            float(count),
        )


def check_partners(sequence: FolderSequence) -> Iterator[Finding]:
    """Look for colour images without depth, depth without colour, and names that are no numbers."""
    files = sequence.files
    if files.depth and files.rgb_without_depth:
        count = len(files.rgb_without_depth)
        yield Finding(
            "missing_frames",
            "warning",
            f"{count} of {len(files.rgb)} colour images have no depth image of their number: "
            f"{some(files.rgb_without_depth)}. Poses there rest on colour alone.",
            float(count),
        )
    if files.depth_without_rgb:
        count = len(files.depth_without_rgb)
        yield Finding(
            "missing_frames",
            "warning",
            f"{counted(count, 'depth image')} without a colour image of that number, not shown: "
            f"{some(files.depth_without_rgb)}. Are both numbered from the same start?",
            float(count),
        )
    if files.ignored:
        yield Finding(
            "missing_frames",
            "info",
            f"{counted(len(files.ignored), 'image')} not used, for want of a number as name: "
            f"{some(files.ignored)}. Name them like 000000.png.",
            float(len(files.ignored)),
        )


def check_image_sizes(sequence: FolderSequence) -> Iterator[Finding]:
    """Name the images of another size than most of their kind; only the beginning of each file is read."""
    for kind, images in (("colour", sequence.files.rgb), ("depth", sequence.files.depth)):
        sizes = {file: _size_wh(file) for file in images.values()}
        counts = Counter(size for size in sizes.values() if size is not None)
        if len(counts) < 2:
            continue
        (width, height), _ = counts.most_common(1)[0]
        others = {f: s for f, s in sizes.items() if s is not None and s != (width, height)}
        named = some(f"{f.parent.name}/{f.name} ({w} x {h})" for f, (w, h) in others.items())
        yield Finding(
            "size_mismatch",
            "error",
            f"{len(others)} of {counted(len(sizes), f'{kind} image')} not {width} x {height} as the others: "
            f"{named}. Copy them again, or take them out.",
            float(len(others)),
        )


def _size_wh(image: Path) -> tuple[int, int] | None:
    """Width and height that a file begins with; None where it cannot be told."""
    try:
        if image.suffix.lower() == ".npy":
            height, width = np.load(image, mmap_mode="r").shape[:2]
            return width, height
        with Image.open(image) as opened:
            return opened.size
    except (OSError, ValueError, EOFError):
        return None


def check_orientation(sequence: FolderSequence) -> Iterator[Finding]:
    """Name the colour images that other programs show turned, by their EXIF tag; pixels count as they are stored."""
    turned = {
        file: tag for file in sequence.files.rgb.values() if (tag := _exif_orientation(file)) != 1
    }
    if turned:
        named = some(f"{f.parent.name}/{f.name} ({tag})" for f, tag in turned.items())
        yield Finding(
            "orientation",
            "warning",
            f"{counted(len(turned), 'colour image')} with an EXIF orientation, by which other programs turn "
            f"them: {named}. Pixels are used as they are stored: camera file and depth must be of these, "
            "or save the images turned and without the tag.",
            float(len(turned)),
        )


def _exif_orientation(image: Path) -> int:
    """Of a JPEG; 1 of others, whose pixels would have to be decoded for it, and where there is none."""
    try:
        with Image.open(image) as opened:
            tag = opened.getexif().get(Base.Orientation, 1) if opened.format == "JPEG" else 1
    except (OSError, ValueError, EOFError, SyntaxError):
        return 1
    return tag if tag in range(1, 9) else 1


def check_unread(
    unread: Rows[SequenceError], sequence: Sequence, looked_at: int
) -> Iterator[Finding]:
    """Name the images that are broken, or of a kind that is not read.

    Args:
        unread: why frames that were looked at could not be read.
        sequence: whose every image is of another kind than its name says, or lacks its last bytes
            where a copy or a recording was cut off.
        looked_at: how many frames were looked at.
    """
    cut, foreign = _by_ends(sequence) if isinstance(sequence, FolderSequence) else ([], {})
    if cut:
        told = f"{_told(cut)} cut off before the end: {_names(cut)}. Copy them again, or take them out."
        yield _broken(told, len(cut))
    for kind, images in foreign.items():
        yield _broken(
            f"{_told(images)} not read: {_names(images)}. Each is {told_kind(kind)}.", len(images)
        )
    named = tuple(f"{file} " for file in chain(cut, *foreign.values()))
    of_a_kind: dict[str, list[SequenceError]] = {}
    for error in unread:
        if isinstance(error, ImageKindError):
            of_a_kind.setdefault(error.fault, []).append(error)
        elif not isinstance(error, ImageSizeError) and not str(error).startswith(named):
            yield _broken(f"{error}. Copy it again, or take it out.")
    for errors in of_a_kind.values():
        if not str(errors[0]).startswith(named):
            count = len(errors)
            yield _broken(
                f"Not read in {count} of {looked_at} frames looked at: {errors[0]}.", count
            )


def _broken(message: str, count: int | None = None) -> Finding:
    return Finding("broken_images", "error", message, None if count is None else float(count))


def _told(images: Rows[Path]) -> str:
    return counted(len(images), "image")


def _names(images: Rows[Path]) -> str:
    return some(f"{image.parent.name}/{image.name}" for image in images)


def _by_ends(sequence: FolderSequence) -> tuple[list[Path], dict[str, list[Path]]]:
    """By first and last bytes: the images that were cut off, and by kind those of none that is read."""
    cut: list[Path] = []
    foreign: dict[str, list[Path]] = {}
    files, as_depth = sequence.files, DEPTH_KINDS if sequence.has_plain_files else READ_KINDS
    read = dict.fromkeys(files.depth.values(), as_depth) | dict.fromkeys(
        files.rgb.values(), READ_KINDS
    )
    for image in dict.fromkeys([*files.rgb.values(), *files.depth.values()]):
        kind, is_ended = kind_and_end(image)
        if kind is not None and kind not in read[image]:
            foreign.setdefault(kind, []).append(image)
        elif not is_ended:
            cut.append(image)
    return cut, foreign


def check_assembly(sequence: FolderSequence) -> Iterator[Finding]:
    """Say so where sequence.json names an assembly that is not there."""
    if sequence.missing_assembly is not None:
        yield Finding(
            "missing_assembly",
            "warning",
            f"sequence.json names the assembly '{sequence.missing_assembly}', which is neither "
            "bundled nor a path from this folder. Give it with --assembly.",
        )


def check_objects(sequence: Sequence) -> Iterator[Finding]:
    """Count the objects of the truth that are no parts of the assembly.

    Raises:
        SequenceError: scene_gt.json is broken.
    """
    assembly = sequence.assembly
    if assembly is None:
        return
    strangers, repeats = objects_beside(Path(sequence.path), assembly)
    if strangers:
        total = sum(strangers.values())
        yield Finding(
            "distractors",
            "info",
            f"{counted(len(strangers), 'object')} of the truth that {assembly.name} does not have, "
            f"counted as distractors ({total} entries): {some(strangers)}.",
            float(len(strangers)),
        )
    if repeats:
        total = sum(repeats.values())
        is_drawn = shows_drawn_copies(Path(sequence.path))
        advice = (
            "Training images show copies on purpose, and detectors learn from all of them."
            if is_drawn
            else "Give repeated pieces names of their own in the assembly."
        )
        yield Finding(
            "distractors",
            "info",
            f"{total} entries of the truth repeat a part within a frame and are not "
            f"{'judged' if is_drawn else 'used'}: {some(repeats)}. {advice}",
            float(total),
        )
