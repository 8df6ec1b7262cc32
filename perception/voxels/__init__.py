"""Voxel grid of unknown obstacles."""
