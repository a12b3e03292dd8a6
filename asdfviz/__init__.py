"""Assembly state detection and 6D pose, from RGB-D frames to corrected ground truth."""

from __future__ import annotations

__version__ = "0.1.0"
