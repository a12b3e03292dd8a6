"""Synthetic RGB-D data with exact truth: a batched torch renderer, scenes, object packs, sequences."""
