"""Rerun recording of a run."""
