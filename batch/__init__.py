"""Batches of runs: plans, workers, results and statistics."""
