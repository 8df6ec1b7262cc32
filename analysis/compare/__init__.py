"""Comparison of two runs: their alignment, and their divergence."""
