"""Checkpoints of the two backends."""
