"""Rigid transforms, the pinhole camera, point sampling and symmetries. Imports nothing of ours."""
