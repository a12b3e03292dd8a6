"""Measures runs against the truth and sequences against common mistakes; reads, never runs a method."""
