"""Execution of jobs: the batch, executors, worker processes, attempts, and their results."""
