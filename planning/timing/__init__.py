"""Timing: trajectories from paths, within the joints' limits."""
