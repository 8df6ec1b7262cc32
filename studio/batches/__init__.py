"""Batches in the studio: plans, progress, results."""
