"""What a check of a sequence or an assembly reports: findings in plain words, each with the figure behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

Severity: TypeAlias = Literal["info", "warning", "error"]

Kind: TypeAlias = Literal[
    "depth_unit",
    "intrinsics",
    "several_cameras",
    "mesh_unit",
    "state_unit",
    "part_pose",
    "size_mismatch",
    "orientation",
    "missing_frames",
    "frame_step",
    "far_origin",
    "broken_images",
    "missing_depth",
    "missing_assembly",
    "depth_shift",
    "distractors",
    "overlap",
    "floating",
    "same_states",
    "symmetry",
    "unchecked",
]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was noticed."""

    kind: Kind
    severity: Severity
    message: str
    """Plain words: what, the figure, and what to do about it."""
    value: float | None = None
    """The figure: a share (0 to 1), pixels, a factor or a count, as the message says."""


@dataclass(frozen=True, slots=True)
class HealthReport:
    """All findings on a sequence, the gravest first."""

    sequence: str
    path: str
    frames: int
    frames_looked_at: int
    findings: tuple[Finding, ...]

    @property
    def is_readable(self) -> bool:
        """Whether no image was found that cannot be read."""
        return all(finding.kind != "broken_images" for finding in self.findings)

    def to_json(self) -> dict[str, object]:
        """Plain values for JSON."""
        return {
            "sequence": self.sequence,
            "path": self.path,
            "frames": self.frames,
            "frames_looked_at": self.frames_looked_at,
            "findings": _plain(self.findings),
        }


@dataclass(frozen=True, slots=True)
class AssemblyReport:
    """All findings on an assembly by itself."""

    assembly: str
    path: str
    parts: int
    states: int
    findings: tuple[Finding, ...]

    def to_json(self) -> dict[str, object]:
        """Plain values for JSON."""
        return {
            "assembly": self.assembly,
            "path": self.path,
            "parts": self.parts,
            "states": self.states,
            "findings": _plain(self.findings),
        }


def _plain(findings: tuple[Finding, ...]) -> list[dict[str, object]]:
    return [
        {
            "kind": finding.kind,
            "severity": finding.severity,
            "message": finding.message,
            "value": finding.value,
        }
        for finding in findings
    ]
