"""Recipes: one file a method, and the seam through which a user's own method comes in."""
