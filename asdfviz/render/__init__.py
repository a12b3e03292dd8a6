"""The one place that touches OpenGL: depth, ids, colour, overlays and picking."""
