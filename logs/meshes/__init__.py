"""Meshes in a log."""
