"""Trains the detector from generated scene folders."""
