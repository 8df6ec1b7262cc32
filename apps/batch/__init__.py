"""Batches: plans of many runs, the workers that carry them out, results, statistics and reports."""
