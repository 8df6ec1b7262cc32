"""Fault files: the faults of a run, read and checked. Only the simulation carries them out."""
