"""Putting what is held into a hole."""
