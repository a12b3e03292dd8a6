"""Corrected poses and states: the edit file, edits of poses, and the truth that they make."""
