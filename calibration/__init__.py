"""Calibrating cameras and tool at a target: where to look from, what to touch, what follows from it."""
