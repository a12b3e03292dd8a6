"""The detector as methods configure it. Imports torch only when a network is loaded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

from asdfviz.datatypes import Assembly, Detection
from asdfviz.errors import MethodError, WeightsError
from asdfviz.geometry.shapes import Rgb

WEIGHTS = "weights.safetensors"
"""File beside assembly.yaml, or one folder up, that methods use unless told otherwise."""
MASKS = "masks.safetensors"
"""File of the mask branch, beside the weights of its detector."""
SMALLEST_INPUT = 32
"""Pixels; the network halves its input five times."""


@runtime_checkable
class Detects(Protocol):
    """Anything that finds labelled boxes with keypoints in a picture."""

    def detect(self, rgb: Rgb) -> tuple[Detection, ...]:
        """Return what is in the picture, in its pixels."""
        ...


@dataclass(frozen=True)
class NetworkConfig:
    """Which network runs, and how."""

    weights: Path | None = None
    """Trained weights (.safetensors, or .pt of the public package). Default: weights.safetensors
    in the assembly's folder, or in the folder above, where a network for several assemblies lies."""
    image_size: int = 640
    """Longer side of the network's input, pixels. Paper: 1280. Here: 640, what ours is trained at."""
    confidence: float = 0.1
    """Boxes with a lower score are left out, 0 to 1. The authors take 0.3; lower here, because
    poses are checked against depth afterwards, and a weak true box beats none."""
    device: str = "cpu"
    """Torch device, such as cpu or cuda."""
    bfloat16: bool = False
    """Run in bfloat16: faster where the processor has it, keypoints up to a pixel off."""
    backend: Literal["torch", "onnxruntime", "openvino"] = "torch"
    """What computes the network. The last two are optional packages, some 25 % faster on a CPU:
    pip install 'asdfviz[onnxruntime]' or 'asdfviz[openvino]'."""

    def __post_init__(self) -> None:
        """Raise a MethodError where an option is out of its range."""
        if not 0.0 <= self.confidence <= 1.0:
            raise MethodError(f"confidence is {self.confidence:g}, use a score from 0 to 1")
        if self.image_size < SMALLEST_INPUT:
            raise MethodError(
                f"image_size is {self.image_size}, use {SMALLEST_INPUT} pixels or more"
            )


def weights_path(config: NetworkConfig, assembly: Assembly) -> Path:
    """Return the file that the network is read from; it need not exist."""
    if config.weights is not None:
        return config.weights.expanduser().resolve()
    return shipped_weights(assembly, WEIGHTS)


def shipped_weights(assembly: Assembly, name: str) -> Path:
    """Return the file of that name beside assembly.yaml, or the one above if only that is there."""
    own = Path(assembly.path).parent / name
    joint = own.parent.parent / name
    return joint if joint.is_file() and not own.is_file() else own


def masks_path(masks: Path | None, config: NetworkConfig, assembly: Assembly) -> Path:
    """Return the named file of the mask branch, or the one beside the network's; it need not exist."""
    if masks is not None:
        return masks.expanduser().resolve()
    return weights_path(config, assembly).with_name(MASKS)


def has_own_detector(config: NetworkConfig, assembly: Assembly) -> bool:
    """Whether the network is this assembly's alone: its weights lie in the assembly's folder, and know
    no other assembly.

    Raises:
        WeightsError: the weights cannot be read.
    """
    path = weights_path(config, assembly)
    if not path.is_file() or path.parent != Path(assembly.path).resolve().parent:
        return False
    from asdfviz.detector.weights import assemblies_known

    return path.suffix != ".safetensors" or len(assemblies_known(path)) < 2


def has_detector(config: NetworkConfig, assembly: Assembly) -> bool:
    """Whether there is a network for an assembly: weights of its own, or those of several that name it.

    What cannot be read counts as one: whoever loads it is told what is wrong.
    """
    path = weights_path(config, assembly)
    if not path.is_file() or path.parent == Path(assembly.path).resolve().parent:
        return path.is_file()
    from asdfviz.detector.weights import assemblies_known

    try:
        return path.suffix != ".safetensors" or assembly.name in assemblies_known(path)
    except WeightsError:
        return True


def load_detector(
    config: NetworkConfig, assembly: Assembly, *, masks: Path | None = None
) -> Detects:
    """Load the network for an assembly.

    A .pt names no classes: its outputs are taken for the assembly's detector classes, in their
    order.

    Args:
        config: which network, and how it runs.
        assembly: whose classes are asked for.
        masks: weights of the mask branch; None: detections have no masks.

    Raises:
        InputError: the device is not there.
        WeightsError: there are no weights, or they know none of the assembly's classes.
    """
    path = weights_path(config, assembly)
    if not path.is_file():
        raise WeightsError(
            f"no weights for '{assembly.name}' at {path}: train some (`asdfviz train --assembly "
            f"{assembly.path} --fresh 500 --out FOLDER`), or name a file with --detector.weights"
        )
    from asdfviz.detector.detector import Detector, DetectorConfig
    from asdfviz.detector.device import require_device

    require_device(config.device)
    detector = Detector(
        path,
        config=DetectorConfig(
            image_size=config.image_size,
            confidence=config.confidence,
            device=config.device,
            bfloat16=config.bfloat16,
            backend=config.backend,
        ),
        classes=None if path.suffix == ".safetensors" else assembly.detector_classes,
        assembly=assembly.name,
        masks=masks,
    )
    parts = {part.detector_class for part in assembly.parts.values()}
    if not parts & set(detector.classes):
        raise WeightsError(
            f"{path} knows none of the parts of '{assembly.name}': it has "
            f"{', '.join(detector.classes)}; the assembly needs {', '.join(sorted(parts))}"
        )
    return detector
