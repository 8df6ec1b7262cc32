"""Jobs carried out: the batch, executors, worker processes, attempts, what is kept of each."""
