"""Runs a detector's network and its mask branch in one pass, and cuts masks for what was found."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from asdfviz.detector.head import decode
from asdfviz.detector.joint import own_columns
from asdfviz.detector.letterbox import Letterbox
from asdfviz.detector.mask_branch import MaskBranch, RawMasks, box_mask
from asdfviz.detector.mask_weights import load_masks
from asdfviz.detector.network import Network
from asdfviz.detector.precision import has_bfloat16
from asdfviz.geometry.boxes import BoxMask
from asdfviz.geometry.shapes import Box


@dataclass(frozen=True, slots=True, eq=False)
class MaskRun:
    """A fused network with a fused mask branch, in evaluation mode and on their device."""

    network: Network
    branch: MaskBranch
    labels: frozenset[str]
    """Classes that have masks: parts, not states."""
    device: str
    bfloat16: bool

    @classmethod
    def of(
        cls,
        masks: Path,
        *,
        detector: Path,
        assembly: str | None,
        network: Network,
        device: str,
        bfloat16: bool,
    ) -> MaskRun:
        """Load the branch of a network.

        Args:
            masks: weights of the branch.
            detector: weights of the network.
            assembly: whose classes are asked for; None: those of a network of one assembly.
            network: fused and on its device.
            device: a torch device.
            bfloat16: compute so where the device does.

        Raises:
            WeightsError: the branch is missing, corrupt or of another detector or assembly.
        """
        loaded = load_masks(masks, detector=detector)
        labels = own_columns(loaded.classes, assembly or "")
        branch = loaded.branch.fuse().to(device)
        branch.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue] - missing overload in torch's stubs
        return cls(network, branch, frozenset(labels), device, bfloat16)

    def __call__(self, images: Float[Tensor, "1 3 h w"]) -> tuple[Float[Tensor, "1 n a"], RawMasks]:
        """Decoded columns of a picture, as without masks, and the raw masks."""
        inputs = images.to(self.device).contiguous(memory_format=torch.channels_last)
        half = self.bfloat16 and has_bfloat16(self.device)
        kind = torch.device(self.device).type
        with torch.inference_mode(), torch.autocast(kind, dtype=torch.bfloat16, enabled=half):
            raw = self.network(inputs)
            return decode(raw).float(), self.branch(raw.maps)

    def cutter(
        self,
        raw: RawMasks,
        anchors: Int64[Tensor, "found"],
        *,
        plan: Letterbox,
        size_wh: tuple[int, int],
    ) -> Callable[[str, int, Box], BoxMask | None]:
        """Return what gives the mask of a label, a place in `anchors`, and a box in frame pixels."""
        prototypes = raw.prototypes[0].cpu().numpy()
        coefficients = raw.coefficients[0, :, anchors].T.cpu().numpy()

        def cut(label: str, place: int, box_xyxy: Box) -> BoxMask | None:
            if label not in self.labels:
                return None
            return box_mask(
                coefficients[place], prototypes, box_xyxy=box_xyxy, plan=plan, size_wh=size_wh
            )

        return cut
