"""What a batch is to run: plan files, the matrix, its jobs."""
