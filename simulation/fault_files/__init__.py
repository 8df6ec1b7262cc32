"""Faults files: what is to go wrong in a run, read and checked. Only the simulation carries it out."""
