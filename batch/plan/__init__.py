"""Plans of batches: plan files, their matrix and its jobs."""
