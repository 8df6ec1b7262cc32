"""Episodes of a run: causes of failures, the cures tried against each, and their results."""
