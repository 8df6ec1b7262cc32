"""Profile of a run: CPU and simulated time by node of the tree and by part of the work."""
