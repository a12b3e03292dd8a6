"""`asdfviz synth packs` and `images`: what networks are trained on."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from asdfviz.cli.progress import progress_bar, stop_on_interrupt, with_rate
from asdfviz.errors import InputError, Stopped

if TYPE_CHECKING:
    from asdfviz.synth.packs import PackConfig
    from asdfviz.synth.photo_grounds import Photos
    from asdfviz.synth.scene import SceneConfig


@dataclass(frozen=True)
class ImageOptions:
    """Options of both kinds of training images."""

    assembly: str
    """assembly.yaml, its folder, or a bundled name."""
    out: Path
    """Scene folder to write; images that are there already stay."""
    count: int = 1000
    """Images in all."""
    seed: int = 1000
    """The same seed gives the same images; 7000000 to 7999999 belong to test sets."""
    width: int = 640
    """Image width, pixels."""
    height: int = 360
    """Image height, pixels."""
    masks: bool = False
    """Write BOP's mask/ and mask_visib/ too."""
    workers: int = 1
    """Processes that share the work; the images are the same."""
    joblib_backend: Literal["loky", "dask", "ray"] | None = None
    """Share the work by joblib's engine instead; dask and ray reach other machines."""
    device: str = "cpu"
    """Where torch renders: cpu or cuda."""
    grounds: Path | None = None
    """Folder of photos of your own empty table (jpg, png), taken from above: most pictures then
    show the parts on it."""
    ground_width: float = 0.6
    """Metres that the longer side of such a photo shows."""
    ground_share: float = 0.7
    """Share of the pictures whose table is one of the photos."""

    def photos(self) -> Photos:
        """The photos that were asked for, each of them looked at."""
        return photos_in(self.grounds, self.ground_width, self.ground_share)

    def generate(self, config: SceneConfig | PackConfig, *, shift: bool = False) -> None:
        """Generate; Ctrl+C stops after the image in work, the same line goes on."""
        from asdfviz.data.assembly import load_assembly
        from asdfviz.data.atomic import make_folder
        from asdfviz.detector.device import require_device
        from asdfviz.synth.images import generate_images
        from asdfviz.synth.workers import Crew

        require_device(self.device)
        assembly = load_assembly(self.assembly)
        make_folder(self.out)
        with progress_bar("images") as report, stop_on_interrupt() as stop:
            written = generate_images(
                assembly,
                count=self.count,
                seed=self.seed,
                folder=self.out,
                config=config,
                masks=self.masks,
                shift=shift,
                progress=with_rate(report, "images"),
                stop=stop,
                device=self.device,
                crew=Crew(self.workers, self.joblib_backend),
            )
        if written < self.count:
            raise Stopped(
                f"{written} of {self.count} images are in {self.out}; the same line goes on"
            )
        print(self.out)


@dataclass(frozen=True)
class SynthPacks(ImageOptions):
    """Write object packs: dozens of single parts and joined groups an image, turned freely.

    Example: asdfviz synth packs --assembly corner_clamp --count 500 --out data/packs
    """

    groups: float = 0.3
    """Share of joined groups among the objects; 0.8 for a network that is to learn states."""
    sizes_px: tuple[float, float] = (32.0, 120.0)
    """Smallest and largest projected diameter, pixels."""
    coverage: float = 0.62
    """Share of the image that objects fill."""
    strays: float = 0.15
    """Share of groups that are no state: with a part out of place or missing."""
    occluders: float = 0.22
    """Things in front, an object."""
    hand: float = 0.3
    """Probability of a hand in front."""

    def __call__(self) -> None:
        """Generate packs."""
        self.generate(self.config())

    def config(self) -> PackConfig:
        """How the packs are drawn."""
        from asdfviz.synth.packs import PackConfig

        names = {field.name for field in fields(PackConfig)}
        values = {name: value for name, value in vars(self).items() if name in names}
        return PackConfig(**values, photos=self.photos())


@dataclass(frozen=True)
class SynthImages(ImageOptions):
    """Write scenes: parts loose and joined on a table, distractors, hands, RGB-D with truth.

    Example: asdfviz synth images --assembly corner_clamp --count 500 --out data/train --workers 2
    """

    shift: bool = False
    """Shift depth against colour, as it is in the paper's real frames."""

    def __call__(self) -> None:
        """Generate scenes."""
        from asdfviz.synth.scene import SceneConfig

        config = SceneConfig(width=self.width, height=self.height, photos=self.photos())
        self.generate(config, shift=self.shift)


def photos_in(folder: Path | None, width: float, share: float | None = None) -> Photos:
    """The photos in a folder that was named, none if none was.

    Args:
        folder: JPEG or PNG files.
        width: metres that the longer side of a photo shows.
        share: of the pictures that show one; None for all.

    Raises:
        InputError: as of `find_photos`, or the figures are of photos that there are none of.
    """
    from asdfviz.synth.photo_grounds import Photos, find_photos

    if folder is None:
        none = Photos()
        for option, given, usual in (("width", width, none.width), ("share", share, none.share)):
            if given not in (None, usual):
                raise InputError(
                    f"--ground-{option} {given:g} has no effect without photos: name their folder "
                    "by --grounds, too"
                )
        return none
    with progress_bar("photos") as report:
        return find_photos(
            folder,
            width=width,
            share=1.0 if share is None else share,
            progress=lambda done, total: report(done, total, ""),
        )
