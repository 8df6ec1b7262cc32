"""Simulation of a cell: two backends with their items, feed, injected faults, checkpoints and scorer."""
