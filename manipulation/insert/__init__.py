"""Insertion of the held object into a hole."""
